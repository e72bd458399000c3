#version 330
uniform mat4 u_world_to_clip;
in vec3 a_position;

void main() {
    gl_Position = u_world_to_clip * vec4(a_position, 1.0);
}
