#version 330
// Position and normal of the visible surface, world space, where all of it is one body.
#include "gbuffer.glsl"
in vec3 v_position;
in vec3 v_normal;
layout(location = 0) out vec4 o_position;  // a: 1 where the object is
layout(location = 1) out vec4 o_normal;    // a: body

void main() {
    o_position = vec4(v_position, 1.0);
    o_normal = vec4(unit_normal(v_normal), 0.0);
}
