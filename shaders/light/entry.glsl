// What the nodes are too coarse for of light that enters, transport `diffusion`: factors on irradiance by the light's
// cosine and the object's thickness, tabulated by core/transport/diffusion/pixels.py.

#include "bodies.glsl"

uniform bool u_diffusion;
uniform sampler2D t_own;         // columns: thickness; rows: cosine of the refracted ray
uniform sampler2D t_across;
uniform float u_least_cosine;    // of the first row; the last row's is 1
uniform float u_diffuse_cosine;  // that serves for light from all around
uniform sampler3D t_depths;      // 1 / thickness, 1/mm, and how far it is a thin slab
uniform float u_thin_reach;      // thickness of the last column, mm; 0: no part is thin

// Thickness and share of a thin slab at a surface point of a body.
vec2 depths_at(vec3 position, float body) {
    if (u_thin_reach == 0.0) return vec2(0.0);
    vec2 depths = textureLod(t_depths, volume_coordinates(position, body), 0.0).rg;
    return vec2(1.0 / max(depths.x, 1.0 / u_thin_reach), depths.y);
}

// cosine: of the light to the normal, outside.
vec3 entry_factor(sampler2D table, float cosine, float thickness) {
    float inside = sqrt(max(0.0, 1.0 - (1.0 - cosine * cosine) / (u_eta * u_eta)));
    if (u_light_kind == LIGHT_ENVIRONMENT || u_light_kind == LIGHT_REENTERING) inside = u_diffuse_cosine;
    vec2 size = vec2(textureSize(table, 0));
    vec2 place = vec2(u_thin_reach > 0.0 ? thickness / u_thin_reach : 0.0,
                      (inside - u_least_cosine) / max(1.0 - u_least_cosine, 1e-6));
    return textureLod(table, (clamp(place, 0.0, 1.0) * (size - 1.0) + 0.5) / size, 0.0).rgb;
}
