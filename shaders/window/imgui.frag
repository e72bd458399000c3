#version 330
// The panel: glyphs, lines and pictures, sRGB as they are.
uniform sampler2D t_texture;
in vec2 v_uv;
in vec4 v_colour;
out vec4 o_colour;

void main() {
    o_colour = v_colour * texture(t_texture, v_uv);
}
