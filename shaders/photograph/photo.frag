#version 330
// A photograph with its object in another material: soft edges, the background filled in behind them, the
// photograph's own tone curve; only of the pixels that photo_backdrop.frag found to change. Mirrors
// viewer/photograph/composite.py.
#include "photographic.glsl"

uniform sampler2D t_photo;   // sRGB and alpha; this and the next two have row 0 at the top
uniform sampler2D t_edges;   // r coverage by the object, g share that the background is filled in
uniform sampler2D t_behind;  // linear RGB of the region, the object filled in
uniform sampler2D t_object;  // rgb weighted by a, with all levels; of the region, row 0 at the bottom
uniform vec4 u_region;       // left, top, width, height; pixels of t_photo
uniform float u_white;
uniform int u_behind;        // BEHIND_FILLED, BEHIND_NOTHING, or else as seen

out vec4 o_colour;  // sRGB in [0, 1]; alpha is not multiplied in

const float ENOUGH = 0.25;  // share of a coarse pixel that is known, from which on it counts in full: were one pixel of
                            // many enough, it would as soon as a linear mean is not 0, in blocks

// Fills where little is known from coarser levels.
vec3 object_radiance(vec2 place) {
    vec4 finest = textureLod(t_object, place, 0.0);
    if (finest.a > 0.999) return finest.rgb;  // as most are
    vec3 sum = vec3(0.0);
    float known = 0.0;
    int levels = int(ceil(log2(float(max(textureSize(t_object, 0).x, textureSize(t_object, 0).y)))));
    for (int level = 0; level <= levels && known < 0.999; level++) {
        vec4 mean = textureLod(t_object, place, float(level));
        float share = (1.0 - known) * min(mean.a / ENOUGH, 1.0);
        sum += share * mean.rgb / max(mean.a, 1e-7);
        known += share;
    }
    return sum / max(known, 1e-6);
}

void main() {
    vec2 size = vec2(textureSize(t_photo, 0));
    vec2 pixel = vec2(gl_FragCoord.x, size.y - gl_FragCoord.y);
    vec4 photo = texelFetch(t_photo, ivec2(pixel), 0);
    vec2 edge = texelFetch(t_edges, ivec2(pixel), 0).rg;
    vec2 place = (pixel - u_region.xy) / u_region.zw;
    vec3 shown = clamp(tone_map(object_radiance(vec2(place.x, 1.0 - place.y)), 1.0, u_white), 0.0, 1.0);
    if (u_behind == BEHIND_NOTHING) {
        o_colour = vec4(srgb(shown), edge.r);
        return;
    }
    if (edge.r == 1.0) {
        o_colour = vec4(srgb(shown), 1.0);
        return;
    }
    vec3 behind = linear(photo.rgb);
    if (u_behind == BEHIND_FILLED) behind = mix(behind, textureLod(t_behind, place, 0.0).rgb, edge.g);
    o_colour = vec4(srgb(mix(behind, shown, edge.r)), max(photo.a, edge.r));
}
