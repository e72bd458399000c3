// What the colours of a surface do to light that leaves at a pixel: nothing without the switch DETAIL.

#ifdef DETAIL
uniform sampler2D t_colour;  // of detail.frag
uniform float u_after;       // power of the colour on exitance

vec3 tint_leaving(ivec2 pixel) {
    return u_after > 0.0 ? pow(texelFetch(t_colour, pixel, 0).rgb, vec3(u_after)) : vec3(1.0);
}
#else
vec3 tint_leaving(ivec2 pixel) { return vec3(1.0); }
#endif
