#version 330
// The picture: object, ground and background, through the same display transform.
// Each switch leaves out what llvmpipe computes of all branches, taken or not. TABLE: a table of the display transform
// instead of the formula of photographic.glsl. MIXED: pixels also show what is behind the object; else it has each one
// that is drawn to itself. SURROUND: behind it is an environment, with the object's exposure and transform.
#include "photographic.glsl"
#ifdef TABLE
#include "display_table.glsl"
#endif
#ifdef SURROUND
#include "latlong.glsl"
#endif

uniform sampler2D t_radiance;  // rgb weighted by coverage, a coverage
uniform float u_exposure;      // key / log-average brightness
uniform bool u_directions;     // t_radiance holds unit vectors, drawn as (n + 1) / 2
#ifdef TABLE
uniform sampler3D t_display;
#else
uniform float u_white;         // scaled luminance that becomes white
#endif
#ifdef MIXED
uniform sampler2D t_ground;    // as t_radiance, of the ground without the object
uniform bool u_grounded;       // whether it is there
uniform bool u_transparent;    // whether nothing is behind
#endif
#ifdef SURROUND
uniform sampler2D t_probe;
uniform mat4 u_clip_to_probe;  // rays, probe space: direction = (M (x, y, 1, 1)) / w - (M (x, y, -1, 1)) / w
uniform float u_probe_intensity;
#else
#ifdef MIXED
uniform vec3 u_background;     // linear RGB of the display
#endif
#endif

const float BRIGHTEST = 1e9;   // exposed radiance; more would overflow

out vec4 o_colour;  // sRGB in [0, 1]; alpha is not multiplied in

// sRGB, in [0, 1] whatever the radiance is.
vec3 displayed(vec3 radiance) {
    vec3 exposed = u_exposure * radiance;
    for (int i = 0; i < 3; ++i)  // comparisons with NaN are false
        exposed[i] = exposed[i] > 0.0 ? min(exposed[i], BRIGHTEST) : 0.0;
#ifdef TABLE
    return clamp(display_table(t_display, exposed), 0.0, 1.0);
#else
    return srgb(tone_map(exposed, 1.0, u_white));
#endif
}

#ifdef MIXED
// Linear RGB of the display.
vec3 background() {
#ifdef SURROUND
    vec2 clip = 2.0 * gl_FragCoord.xy / vec2(textureSize(t_radiance, 0)) - 1.0;
    vec4 far = u_clip_to_probe * vec4(clip, 1.0, 1.0);
    vec4 near = u_clip_to_probe * vec4(clip, -1.0, 1.0);
    vec3 direction = normalize(far.xyz / far.w - near.xyz / near.w);
    return linear(displayed(u_probe_intensity * textureLod(t_probe, latlong_uv(direction), 0.0).rgb));
#else
    return u_background;
#endif
}
#endif

void main() {
    vec4 radiance = texelFetch(t_radiance, ivec2(gl_FragCoord.xy), 0);
#ifdef MIXED
    if (u_grounded) radiance += max(1.0 - radiance.a, 0.0) * texelFetch(t_ground, ivec2(gl_FragCoord.xy), 0);
#endif
    vec3 mean = radiance.rgb / max(radiance.a, 1e-30);
    o_colour = vec4(u_directions ? 0.5 * mean + 0.5 : displayed(mean), 1.0);
#ifdef MIXED
    if (u_transparent) o_colour = vec4(radiance.a > 0.0 ? o_colour.rgb : vec3(0.0), radiance.a);
    else o_colour.rgb = srgb(mix(background(), linear(o_colour.rgb), radiance.a));
#endif
}
