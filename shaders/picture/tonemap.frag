#version 330
// The picture: object, ground and background, through the same display transform.
#include "photographic.glsl"
#include "display_table.glsl"
#include "latlong.glsl"

uniform sampler2D t_radiance;  // rgb weighted by coverage, a coverage
uniform sampler2D t_ground;    // the same of the ground, as without the object
uniform bool u_grounded;       // whether it is there
uniform sampler2D t_probe;
uniform sampler3D t_display;   // table of the display transform
uniform bool u_photographic;   // the formula of photographic.glsl instead of the table
uniform float u_exposure;      // key / log-average brightness
uniform float u_white;         // scaled luminance that becomes white, of the formula
// BACKGROUND_COLOUR: u_background, sRGB, not tone-mapped. BACKGROUND_TRANSPARENT. BACKGROUND_ENVIRONMENT: t_probe,
// with the object's exposure and transform.
uniform int u_background_kind;
uniform vec3 u_background;
uniform mat4 u_clip_to_probe;  // rays, probe space: direction = (M (x, y, 1, 1)) / w - (M (x, y, -1, 1)) / w
uniform float u_probe_intensity;
uniform bool u_directions;     // t_radiance holds unit vectors, drawn as (n + 1) / 2

const float BRIGHTEST = 1e9;   // exposed radiance; more would overflow

out vec4 o_colour;  // sRGB in [0, 1]; alpha is not multiplied in

// Linear RGB of the display, in [0, 1] whatever the radiance is.
vec3 displayed(vec3 radiance) {
    vec3 exposed = u_exposure * radiance;
    for (int i = 0; i < 3; ++i)  // comparisons with NaN are false
        exposed[i] = exposed[i] > 0.0 ? min(exposed[i], BRIGHTEST) : 0.0;
    vec3 shown = u_photographic ? tone_map(exposed, 1.0, u_white) : linear(display_table(t_display, exposed));
    return clamp(shown, 0.0, 1.0);
}

vec3 background(vec2 pixel) {
    if (u_background_kind != BACKGROUND_ENVIRONMENT) return linear(u_background);
    vec2 clip = 2.0 * pixel / vec2(textureSize(t_radiance, 0)) - 1.0;
    vec4 far = u_clip_to_probe * vec4(clip, 1.0, 1.0);
    vec4 near = u_clip_to_probe * vec4(clip, -1.0, 1.0);
    vec3 direction = normalize(far.xyz / far.w - near.xyz / near.w);
    vec3 radiance = u_probe_intensity * textureLod(t_probe, latlong_uv(direction), 0.0).rgb;
    return displayed(radiance);
}

void main() {
    vec4 radiance = texelFetch(t_radiance, ivec2(gl_FragCoord.xy), 0);
    if (u_grounded) radiance += max(1.0 - radiance.a, 0.0) * texelFetch(t_ground, ivec2(gl_FragCoord.xy), 0);
    vec3 object = vec3(0.0);
    if (radiance.a > 0.0) {
        vec3 mean = radiance.rgb / radiance.a;
        object = u_directions ? linear(0.5 * mean + 0.5) : displayed(mean);
    }
    if (u_background_kind == BACKGROUND_TRANSPARENT)
        o_colour = vec4(srgb(object), radiance.a);
    else
        o_colour = vec4(srgb(mix(background(gl_FragCoord.xy), object, radiance.a)), 1.0);
}
