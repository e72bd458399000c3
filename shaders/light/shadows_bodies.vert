#version 330
uniform mat4 u_world_to_clip;
in vec3 a_position;
in float a_body;  // the same at all corners of a face
flat out float v_body;

void main() {
    v_body = a_body;
    gl_Position = u_world_to_clip * vec4(a_position, 1.0);
}
