#version 330
// BODIES: with the body of each vertex, the same at all corners of a face.
uniform mat4 u_world_to_clip;
in vec3 a_position;

#ifdef BODIES
in float a_body;
flat out float v_body;
#endif

void main() {
#ifdef BODIES
    v_body = a_body;
#endif
    gl_Position = u_world_to_clip * vec4(a_position, 1.0);
}
