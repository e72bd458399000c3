#version 330
uniform mat4 u_world_to_clip;
in vec3 a_position;
in vec3 a_normal;
in vec2 a_coordinates;
in vec3 a_colour;
in vec4 a_tangent;  // xyz: direction of growing u, 0 where there is none; w: -1 where the texture is mirrored
out vec3 v_normal;
out vec2 v_coordinates;
out vec3 v_colour;
out vec4 v_tangent;

void main() {
    v_normal = a_normal;
    v_coordinates = a_coordinates;
    v_colour = a_colour;
    v_tangent = a_tangent;
    gl_Position = u_world_to_clip * vec4(a_position, 1.0);
}
