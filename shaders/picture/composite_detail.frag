#version 330
// As composite.frag, where the surface has colours or relief.
#include "detail_leaving.glsl"
#include "composite.frag"
