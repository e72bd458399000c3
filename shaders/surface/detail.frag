#version 330
// Colour and relief of the visible surface, faces of one material; core/geometry/detail.py does the same for samples.
#include "gbuffer.glsl"
in vec3 v_normal;
in vec2 v_coordinates;
in vec3 v_colour;
in vec4 v_tangent;
uniform vec3 u_factor;
uniform bool u_has_colours;
uniform sampler2D t_colours;    // sRGB, decoded by the sampler
uniform bool u_has_relief;
uniform sampler2D t_relief;     // (v - 128) / 127 along u, along v and outwards
uniform float u_strength;
layout(location = 0) out vec4 o_colour;   // linear
layout(location = 1) out vec4 o_shading;  // rgb: normal that light meets; a: factor on irradiance

// A mean of cosines is that of the mean normal, hence the factor, the length of what mip-mapping made of it.
vec4 relief(vec3 normal, vec3 along, vec3 bytes) {
    vec3 mean = max((255.0 * bytes - 128.0) / 127.0, -1.0);
    vec3 across = v_tangent.w < 0.0 ? -cross(normal, along) : cross(normal, along);
    vec3 slope = u_strength * (mean.x * along + mean.y * across);
    float shortened = 1.0 - min(length(mean), 1.0);
    return vec4(normalize(slope + max(mean.z, MIN_NORMAL_HEIGHT) * normal), max(1.0 - u_strength * u_strength * shortened, 0.0));
}

void main() {
    vec3 normal = unit_normal(v_normal);
    vec3 along = v_tangent.xyz - dot(v_tangent.xyz, normal) * normal;
    vec4 shading = vec4(normal, 1.0);
    if (u_has_relief && dot(along, along) > 1e-12)
        shading = relief(normal, normalize(along), texture(t_relief, v_coordinates).rgb);
    vec3 colour = u_factor * v_colour;
    if (u_has_colours) colour *= texture(t_colours, v_coordinates).rgb;
    o_colour = vec4(max(colour, 0.0), 1.0);
    o_shading = shading;
}
