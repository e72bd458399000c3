#version 330
// Photographic tone reproduction (Reinhard et al. 2002, equations 2 and 4), then sRGB (IEC 61966-2-1).
// Mirrors core/tonemap.py.
#include "luminance.glsl"
#include "latlong.glsl"

const int BACKGROUND_COLOUR = 0;       // u_background, sRGB, not tone-mapped
const int BACKGROUND_TRANSPARENT = 1;
const int BACKGROUND_ENVIRONMENT = 2;  // t_probe, tone-mapped with the object's exposure

uniform sampler2D t_radiance;  // rgb weighted by coverage, a coverage
uniform sampler2D t_probe;
uniform float u_exposure;      // key / log-average luminance
uniform float u_white;         // scaled luminance that becomes white
uniform int u_background_kind;
uniform vec3 u_background;
uniform mat4 u_clip_to_probe;  // rays, probe space: direction = (M (x, y, 1, 1)) / w - (M (x, y, -1, 1)) / w
uniform float u_probe_intensity;
uniform bool u_directions;     // t_radiance holds unit vectors, drawn as (n + 1) / 2

out vec4 o_colour;  // sRGB in [0, 1]; alpha is not multiplied in

vec3 tone_map(vec3 radiance) {
    float scaled = u_exposure * luminance(radiance);
    return u_exposure * radiance * (1.0 + scaled / (u_white * u_white)) / (1.0 + scaled);
}

vec3 srgb(vec3 linear) {
    vec3 x = clamp(linear, 0.0, 1.0);
    return mix(1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, 12.92 * x, vec3(lessThanEqual(x, vec3(0.0031308))));
}

vec3 linear(vec3 srgb) {
    return mix(pow((srgb + 0.055) / 1.055, vec3(2.4)), srgb / 12.92, vec3(lessThanEqual(srgb, vec3(0.04045))));
}

vec3 background(vec2 pixel) {
    if (u_background_kind != BACKGROUND_ENVIRONMENT) return linear(u_background);
    vec2 clip = 2.0 * pixel / vec2(textureSize(t_radiance, 0)) - 1.0;
    vec4 far = u_clip_to_probe * vec4(clip, 1.0, 1.0);
    vec4 near = u_clip_to_probe * vec4(clip, -1.0, 1.0);
    vec3 direction = normalize(far.xyz / far.w - near.xyz / near.w);
    return tone_map(u_probe_intensity * textureLod(t_probe, latlong_uv(direction), 0.0).rgb);
}

void main() {
    vec4 radiance = texelFetch(t_radiance, ivec2(gl_FragCoord.xy), 0);
    vec3 object = vec3(0.0);
    if (radiance.a > 0.0) {
        vec3 mean = radiance.rgb / radiance.a;
        object = u_directions ? linear(0.5 * mean + 0.5) : clamp(tone_map(mean), 0.0, 1.0);
    }
    if (u_background_kind == BACKGROUND_TRANSPARENT)
        o_colour = vec4(srgb(object), radiance.a);
    else
        o_colour = vec4(srgb(mix(clamp(background(gl_FragCoord.xy), 0.0, 1.0), object, radiance.a)), 1.0);
}
