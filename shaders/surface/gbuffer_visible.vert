#version 330
uniform mat4 u_world_to_clip;
in vec3 a_position;
in vec3 a_normal;
in float a_body;  // the same at all corners of a face
in vec3 a_visible;
in vec3 a_behind;
in vec4 a_lobe;
out vec3 v_position;
out vec3 v_normal;
flat out float v_body;
out vec3 v_visible;
out vec3 v_behind;
out vec4 v_lobe;

void main() {
    v_position = a_position;
    v_normal = a_normal;
    v_body = a_body;
    v_visible = a_visible;
    v_behind = a_behind;
    v_lobe = a_lobe;
    gl_Position = u_world_to_clip * vec4(a_position, 1.0);
}
