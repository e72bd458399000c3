#version 330
// Irradiance of one light on the surface samples, by transform feedback.
#include "irradiance.glsl"

in vec3 a_position;
in vec3 a_normal;
out vec3 v_irradiance;

void main() {
    v_irradiance = u_light_kind == ENVIRONMENT
        ? environment_irradiance(a_normal)
        : entering(arrive(a_position, a_normal), a_normal);
}
