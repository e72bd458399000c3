#version 330
uniform mat4 u_world_to_clip;
in vec3 a_position;
in vec3 a_normal;
in float a_body;  // the same at all corners of a face
out vec3 v_position;
out vec3 v_normal;
flat out float v_body;

void main() {
    v_position = a_position;
    v_normal = a_normal;
    v_body = a_body;
    gl_Position = u_world_to_clip * vec4(a_position, 1.0);
}
