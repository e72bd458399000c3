#version 330
// The panel: triangles of Dear ImGui, in window coordinates.
uniform vec2 u_display_size;  // window coordinates, y down
in vec2 a_position;
in vec2 a_uv;
in vec4 a_colour;             // sRGB, alpha not multiplied in
out vec2 v_uv;
out vec4 v_colour;

void main() {
    v_uv = a_uv;
    v_colour = a_colour;
    gl_Position = vec4(vec2(2.0, -2.0) * a_position / u_display_size + vec2(-1.0, 1.0), 0.0, 1.0);
}
