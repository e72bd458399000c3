#version 330
// Grid coordinates (u, v, layer) of the surface samples, by transform feedback; layer is view depth in units of dz.
uniform mat4 u_world_to_grid;
in vec3 a_position;
out vec3 v_coordinates;

void main() {
    v_coordinates = (u_world_to_grid * vec4(a_position, 1.0)).xyz;
}
