#version 330
// As gbuffer.frag, with the body of the visible surface: llvmpipe takes a fifth longer for it.
#include "gbuffer.glsl"
in vec3 v_position;
in vec3 v_normal;
flat in float v_body;
layout(location = 0) out vec4 o_position;
layout(location = 1) out vec4 o_normal;

void main() {
    o_position = vec4(v_position, 1.0);
    o_normal = vec4(unit_normal(v_normal), v_body);
}
