#version 330
// Reinhard et al. 2002, Photographic Tone Reproduction for Digital Images: sums over a tile of pixels for the
// log-average, equation 1, of the brightest channel, weighted as core/display.py does; one output pixel a tile.
// r: sum of weights * log(brightness), g: sum of weights, b: sum of coverage * brightness, a: sum of coverage.

uniform sampler2D t_radiance;  // rgb weighted by coverage, a coverage
uniform ivec2 u_tile;          // pixels
uniform int u_step;            // from one that counts to the next, in rows and columns
uniform float u_mean;          // brightness by which a pixel has half its weight; > 0

const float BRIGHTEST = 3e38;  // finite, as float32

out vec4 o_sums;

void main() {
    ivec2 start = ivec2(gl_FragCoord.xy) * u_tile;
    ivec2 stop = min(start + u_tile, textureSize(t_radiance, 0));
    vec4 sums = vec4(0.0);
    for (int y = start.y; y < stop.y; y += u_step)
        for (int x = start.x; x < stop.x; x += u_step) {
            vec4 radiance = texelFetch(t_radiance, ivec2(x, y), 0);
            vec3 mean = radiance.rgb / radiance.a;
            float value = max(mean.r, max(mean.g, mean.b));
            bool known = all(lessThanEqual(abs(mean), vec3(BRIGHTEST)));  // false of NaN
            if (!(radiance.a > 0.0 && known && value >= 0.0)) continue;
            float weight = radiance.a * value / (value + u_mean);
            sums += vec4(weight * log(max(value, 1e-37)), weight, radiance.a * value, radiance.a);
        }
    o_sums = sums;
}
