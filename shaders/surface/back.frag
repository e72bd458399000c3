#version 330
// Back of the surface, world space, with how far its front is at the pixel.
#include "gbuffer.glsl"

uniform sampler2D t_position;  // of the front; a 1 where the object is
uniform vec4 u_depth;          // of a place, homogeneous, mm, > 0 all over the object

in vec3 v_position;
in vec3 v_normal;
layout(location = 0) out vec4 o_back;  // a: depth of the front
layout(location = 1) out vec4 o_back_normal;

void main() {
    vec4 front = texelFetch(t_position, ivec2(gl_FragCoord.xy), 0);
    o_back = vec4(v_position, front.a > 0.0 ? dot(u_depth, vec4(front.xyz, 1.0)) : 0.0);
    o_back_normal = vec4(unit_normal(v_normal), 1.0);
}
