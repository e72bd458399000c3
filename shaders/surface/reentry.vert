#version 330
// Irradiance of light that left the object and enters it again, known at the vertices.
uniform mat4 u_world_to_clip;
in vec3 a_position;
in vec3 a_irradiance;
in vec3 a_behind;  // the same on the other side of the object
out vec3 v_irradiance;
out vec3 v_behind;

void main() {
    v_irradiance = a_irradiance;
    v_behind = a_behind;
    gl_Position = u_world_to_clip * vec4(a_position, 1.0);
}
