#version 330
// As gbuffer_bodies.frag, with the share of the environment's light that the surface is not in the way of.
#include "gbuffer.glsl"
in vec3 v_position;
in vec3 v_normal;
flat in float v_body;
in vec4 v_visible;
layout(location = 0) out vec4 o_position;
layout(location = 1) out vec4 o_normal;
layout(location = 2) out vec4 o_visible;  // rgb: of irradiance; a: of the highlight's lobe

void main() {
    o_position = vec4(v_position, 1.0);
    o_normal = vec4(unit_normal(v_normal), v_body);
    o_visible = v_visible;
}
