#version 330
// As irradiance_samples.vert, of a light with a size, through the shadow maps of its sub-lights.
#replace "arrival.glsl" "arrival_soft.glsl"
#include "irradiance_samples.vert"
