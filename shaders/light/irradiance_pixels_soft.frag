#version 330
// As irradiance_pixels.frag, of a light with a size, through the shadow maps of its sub-lights.
#replace "arrival.glsl" "arrival_soft.glsl"
#replace "shadow_entry.glsl" "shadow_entry_soft.glsl"
#include "irradiance_pixels.frag"
