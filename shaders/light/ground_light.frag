#version 330
// Irradiance of one lamp on the plane that the object stands on, blended additively, lamp by lamp: with the object in its
// way, and without. SOFT: of a light with a size, through the shadow maps of its sub-lights.
#include "irradiance.glsl"

uniform sampler2D t_place;  // of ground_place.frag, or the places of a map of the plane

layout(location = 0) out vec4 o_lit;
layout(location = 1) out vec4 o_open;

const vec3 UP = vec3(0.0, 1.0, 0.0);

void main() {
    vec4 place = texelFetch(t_place, ivec2(gl_FragCoord.xy), 0);
    if (place.a == 0.0) discard;
    vec3 lit = vec3(0.0), open = vec3(0.0);
    if (u_light_kind == LIGHT_ENVIRONMENT) {
        lit = open = environment_irradiance(UP);
    } else {
        for (int i = first_sub_light(); i < sub_lights(); i = next_sub_light(i)) {
            lit += entering(arrive(i, place.xyz, UP), UP);
            open += entering(unshadowed(i, place.xyz), UP);
        }
    }
    o_lit = vec4(lit, 0.0);
    o_open = vec4(open, 0.0);
}
