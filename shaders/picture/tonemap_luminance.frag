#version 330
// Reinhard et al. 2002, Photographic Tone Reproduction for Digital Images: sums over a tile of pixels for the
// log-average luminance, equation 1; one output pixel a tile.
// r: sum of coverage * log(floor + luminance), g: sum of coverage * luminance, b: sum of coverage.
#include "luminance.glsl"

uniform sampler2D t_radiance;  // rgb weighted by coverage, a coverage
uniform ivec2 u_tile;          // pixels
uniform float u_floor;         // keeps the logarithm of unlit pixels finite; > 0

out vec4 o_sums;

void main() {
    ivec2 start = ivec2(gl_FragCoord.xy) * u_tile;
    ivec2 stop = min(start + u_tile, textureSize(t_radiance, 0));
    vec3 sums = vec3(0.0);
    for (int y = start.y; y < stop.y; ++y)
        for (int x = start.x; x < stop.x; ++x) {
            vec4 radiance = texelFetch(t_radiance, ivec2(x, y), 0);
            if (radiance.a == 0.0) continue;
            float value = luminance(radiance.rgb / radiance.a);
            sums += radiance.a * vec3(log(u_floor + value), value, 1.0);
        }
    o_sums = vec4(sums, 0.0);
}
