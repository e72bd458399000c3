#version 330
// As irradiance_pixels_soft.frag, where the surface has colours or relief.
#replace "arrival.glsl" "arrival_soft.glsl"
#replace "shadow_entry.glsl" "shadow_entry_soft.glsl"
#include "irradiance_pixels_detail.frag"
