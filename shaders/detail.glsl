// Colours of the model's surface at a pixel, drawn by detail.frag where there are any.

uniform bool u_detailed;
uniform sampler2D t_colour;

vec3 colour_at(ivec2 pixel, float power) {
    return power == 0.0 ? vec3(1.0) : pow(texelFetch(t_colour, pixel, 0).rgb, vec3(power));
}
