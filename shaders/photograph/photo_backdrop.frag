#version 330
// What of a photograph stays as it is while its object changes, and, as depth, where the object goes: photo.frag then
// draws those pixels alone.

uniform sampler2D t_photo;  // sRGB and alpha; row 0 at the top, as of the next
uniform sampler2D t_edges;  // r coverage by the object, g share that the background is filled in
uniform int u_behind;       // see photo.frag

out vec4 o_colour;  // sRGB in [0, 1]; alpha is not multiplied in

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.x, float(textureSize(t_photo, 0).y) - gl_FragCoord.y);
    vec2 edge = texelFetch(t_edges, pixel, 0).rg;
    bool changes = edge.r > 0.0 || (u_behind == BEHIND_FILLED && edge.g > 0.0);
    gl_FragDepth = changes ? 0.0 : 1.0;
    o_colour = u_behind == BEHIND_NOTHING ? vec4(0.0) : texelFetch(t_photo, pixel, 0);
}
