#version 330
// Radiance of the plane that the object stands on, albedo E / pi, with its share of the pixel. As a shadow it is what the object changes alone: over a background B that
// stands for the plane in the open, of radiance P, share and radiance leave (1 - a) B + rgb, which is the plane's own
// radiance where B is P.
uniform sampler2D t_place;  // of ground_place.frag
uniform sampler2D t_lit;    // E of all lights
uniform sampler2D t_open;   // E of all lights in the open
uniform vec3 u_albedo;
uniform bool u_shadow_alone;

out vec4 o_radiance;        // rgb weighted by a, its share

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float share = texelFetch(t_place, pixel, 0).a;
    vec3 radiance = u_albedo / PI * texelFetch(t_lit, pixel, 0).rgb;
    float changed = 1.0;
    if (u_shadow_alone) {
        vec3 open = u_albedo / PI * texelFetch(t_open, pixel, 0).rgb;
        vec3 darker = 1.0 - radiance / max(open, 1e-30), brighter = 1.0 - open / max(radiance, 1e-30);
        vec3 change = clamp(max(darker, brighter), 0.0, 1.0);
        changed = max(change.r, max(change.g, change.b));
        radiance = max(radiance - (1.0 - changed) * open, 0.0);
    }
    o_radiance = share * vec4(radiance, changed);
}
