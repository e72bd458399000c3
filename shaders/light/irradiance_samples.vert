#version 330
// Irradiance of one light on the surface samples, by transform feedback.
// SOFT: of a light with a size, through the shadow maps of its sub-lights.
#include "irradiance.glsl"

in vec3 a_position;
in vec3 a_normal;
out vec3 v_irradiance;

void main() {
    if (u_light_kind == LIGHT_ENVIRONMENT) {
        v_irradiance = environment_irradiance(a_normal);
        return;
    }
    v_irradiance = vec3(0.0);
    for (int i = first_sub_light(); i < sub_lights(); i = next_sub_light(i))
        v_irradiance += entering(arrive(i, a_position, a_normal), a_normal);
}
