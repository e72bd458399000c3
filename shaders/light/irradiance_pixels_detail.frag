#version 330
// As irradiance_pixels.frag, where the surface has colours or relief.
#include "detail_entering.glsl"
#include "irradiance_pixels.frag"
