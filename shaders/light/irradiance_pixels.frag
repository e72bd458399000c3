#version 330
// Irradiance, highlight and local part of exitance of one light at every pixel of the G-buffer; blended additively,
// light by light. The local part is the term of core/transport/pixels.py, factor(0) E here + factor(thickness) E on the
// other side; or, with transport `diffusion`, what light adds to the right-hand side of the equation of
// core/transport/diffusion/pixels.py: here in o_local.rgb, and on the other side of a thin slab in the three alphas.
// Highlight: Phong 1975, irradiance at normal incidence * max(0, r.l)^shininess, r the mirrored eye ray; of an
// environment, its radiance under the same lobe, prefiltered (core/light/highlights.py).
// SHARES: in o_irradiance and o_specular the visible shares of lamps, a channel each. What a lamp gives at a place depends
// on little of the matter: it is stored, and read for other matter.
// SOFT: of a light with a size, through the shadow maps of its sub-lights. DETAIL: the surface has colours or relief.
#include "irradiance.glsl"
#include "sheet.glsl"
#include "entry.glsl"
#include "highlights.glsl"
#ifdef SOFT
#include "highlights_discs.glsl"
#endif
#include "visible.glsl"
#include "detail_entering.glsl"
#include "lamplight.glsl"

uniform sampler2D t_position;  // rgb world, mm; a 1 where the object is
uniform sampler2D t_normal;    // a: body
uniform sampler2D t_visible;   // visible share of the environment's light; a: on the other side of a thin slab, see u_stored
uniform sampler2D t_lobe;      // of the highlight's
uniform bool u_occluded;       // whether t_visible is there
uniform sampler2D t_known;         // E of light that left the object and enters it again, see u_stored; any of another kind
uniform sampler2D t_known_behind;  // the same on the other side of the object
uniform bool u_occluded_lobe;  // whether t_lobe is there
uniform float u_clear_from;    // number of the first body that scatters no light
uniform float u_clear_eta;     // of the surface of such
uniform vec4 u_eye;            // homogeneous: (position, 1), or (direction towards the eye, 0) if orthographic

#ifdef SHARES
uniform vec3 u_first_lamps;  // 1 in the channel of this lamp, where it is one of them, else 0
uniform vec3 u_last_lamps;
uniform bool u_stores;       // whether to write what lamplight.glsl gives, in place of all else
uniform bool u_stored;       // whether to read that of a lamp, as stored in the order of the outputs: t_known holds E and its
                             // cosine, t_known_behind the same behind a slab, t_visible the lamp's share, a: its thickness

// E of the light regardless of what is in its way.
vec3 unshadowed_irradiance(vec3 position, vec3 normal) {
    vec3 sum = vec3(0.0);
    for (int i = first_sub_light(); i < sub_lights(); i = next_sub_light(i)) sum += entering(unshadowed(i, position), normal);
    return sum;
}
#endif

layout(location = 0) out vec4 o_irradiance;
layout(location = 1) out vec4 o_specular;
layout(location = 2) out vec4 o_local;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 position = texelFetch(t_position, pixel, 0);
    if (position.a == 0.0) discard;
    vec4 normal_and_body = texelFetch(t_normal, pixel, 0);
    if (!is_drawn(normal_and_body.a)) discard;
    vec3 normal = normal_and_body.xyz;
    mirroring_eta = normal_and_body.a < u_clear_from ? u_eta : u_clear_eta;
    vec4 shading = shading_normal(pixel, normal);
    vec3 to_eye = normalize(u_eye.xyz - u_eye.w * position.xyz);
    vec3 irradiance, specular = vec3(0.0);
    Behind behind = NOTHING_BEHIND;
    float cosine = 1.0;
    if (u_light_kind == LIGHT_ENVIRONMENT) {
        irradiance = shading.a * environment_irradiance(shading.xyz);
        if (u_thin_reach > 0.0) behind.irradiance = environment_irradiance(-normal);
        if (u_occluded) {
            vec4 visible = texelFetch(t_visible, pixel, 0);
            irradiance *= visible.rgb;
            behind.irradiance *= unpacked_share(visible.a);
        }
        vec4 lobe = u_occluded_lobe ? texelFetch(t_lobe, pixel, 0) : vec4(0.0, 0.0, 0.0, 1.0);
        specular = environment_highlight(shading.xyz, to_eye, lobe);
        specular *= above_surface(normal, shading.xyz, reflect(-to_eye, shading.xyz));
    } else if (u_light_kind == LIGHT_REENTERING) {
        irradiance = shading.a * texelFetch(t_known, pixel, 0).rgb;
        if (u_thin_reach > 0.0) behind.irradiance = texelFetch(t_known_behind, pixel, 0).rgb;
    } else {
        Lamplight light;
#ifdef SHARES
        if (u_stored) {
            vec4 entering = texelFetch(t_known, pixel, 0), other_side = texelFetch(t_known_behind, pixel, 0);
            float thickness = texelFetch(t_visible, pixel, 0).a;
            light = Lamplight(entering.rgb, vec3(0.0), entering.a, Behind(other_side.rgb, thickness, other_side.a));
        } else
#endif
        light = lamplight(position.xyz, normal, shading, to_eye, normal_and_body.a);
        irradiance = light.irradiance;
        specular = light.specular;
        cosine = light.cosine;
        behind = light.behind;
    }
    irradiance *= tint_entering(pixel);
    behind.irradiance *= tint_behind(position.xyz - behind.thickness * normal);
    vec3 local, other = vec3(0.0);
    if (normal_and_body.a >= u_clear_from) {
        irradiance = vec3(0.0);
    } else if (u_diffusion) {
        vec2 depths = depths_at(position.xyz, normal_and_body.a);
        local = entry_factor(t_own, cosine, depths.x) * irradiance;
        if (depths.y > 0.0) {
            local += depths.y * entry_factor(t_across, behind.cosine, depths.x) * behind.irradiance;
            other = depths.y * entry_factor(t_across, cosine, depths.x) * irradiance
                + entry_factor(t_own, behind.cosine, depths.x) * behind.irradiance;
        }
    } else {
        local = texelFetch(t_sheet, ivec2(0), 0).rgb * irradiance;
        if (u_sheet_reach > 0.0) local += light_through_sheet(behind);
    }
#ifdef SHARES
    if (u_stores) {
        float share = brightness(irradiance) / max(brightness(unshadowed_irradiance(position.xyz, normal)), 1e-20);
        o_irradiance = vec4(irradiance, cosine);
        o_specular = vec4(behind.irradiance, behind.cosine);
        o_local = vec4(vec3(share), behind.thickness);
        return;
    }
    float share = texelFetch(t_visible, pixel, 0).r;
    irradiance = share * u_first_lamps;
    specular += share * u_last_lamps;
#endif
    o_irradiance = vec4(irradiance, other.r);
    o_specular = vec4(specular, other.g);
    o_local = vec4(local, other.b);
}
