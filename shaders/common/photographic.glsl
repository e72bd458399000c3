// Reinhard et al. 2002, Photographic Tone Reproduction for Digital Images, equations 2 and 4; and sRGB (IEC 61966-2-1).
// Mirrors core/display.py.
#include "luminance.glsl"

// exposure: key / log-average brightness; white: scaled luminance that becomes white
vec3 tone_map(vec3 radiance, float exposure, float white) {
    float scaled = exposure * luminance(radiance);
    return exposure * radiance * (1.0 + scaled / (white * white)) / (1.0 + scaled);
}

vec3 srgb(vec3 linear) {
    vec3 x = clamp(linear, 0.0, 1.0);
    return mix(1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, 12.92 * x, vec3(lessThanEqual(x, vec3(0.0031308))));
}

vec3 linear(vec3 srgb) {
    return mix(pow((srgb + 0.055) / 1.055, vec3(2.4)), srgb / 12.92, vec3(lessThanEqual(srgb, vec3(0.04045))));
}
