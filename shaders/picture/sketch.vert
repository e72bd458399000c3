#version 330
uniform mat4 u_world_to_clip;
uniform mat3 u_world_to_view;
in vec3 a_position;
in vec3 a_normal;
out vec3 v_normal;

void main() {
    v_normal = u_world_to_view * a_normal;
    gl_Position = u_world_to_clip * vec4(a_position, 1.0);
}
