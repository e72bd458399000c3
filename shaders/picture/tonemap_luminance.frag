#version 330
// Reinhard et al. 2002, Photographic Tone Reproduction for Digital Images: sums over a tile of pixels for the
// log-average luminance, equation 1, weighted as core/display.py does; one output pixel a tile.
// r: sum of weights * log(luminance), g: sum of weights, b: sum of coverage * luminance, a: sum of coverage.
#include "luminance.glsl"

uniform sampler2D t_radiance;  // rgb weighted by coverage, a coverage
uniform ivec2 u_tile;          // pixels
uniform float u_mean;          // luminance of which a pixel has half its weight; > 0

const float BRIGHTEST = 3e38;  // finite, as float32

out vec4 o_sums;

void main() {
    ivec2 start = ivec2(gl_FragCoord.xy) * u_tile;
    ivec2 stop = min(start + u_tile, textureSize(t_radiance, 0));
    vec4 sums = vec4(0.0);
    for (int y = start.y; y < stop.y; ++y)
        for (int x = start.x; x < stop.x; ++x) {
            vec4 radiance = texelFetch(t_radiance, ivec2(x, y), 0);
            float value = luminance(radiance.rgb / radiance.a);
            if (!(radiance.a > 0.0 && value >= 0.0 && value <= BRIGHTEST)) continue;
            float weight = radiance.a * value / (value + u_mean);
            sums += vec4(weight * log(max(value, 1e-37)), weight, radiance.a * value, radiance.a);
        }
    o_sums = sums;
}
