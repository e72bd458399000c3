#version 330
// Radiance towards the eye: exitance gathered from the layers, L = F_t M / N with N = pi, (7), or int F_t cos dw, by
// which flux is M (core/transport/quality.py); plus the highlight.
// Exitance is M = gathered + local: what the layers carry, and what they are too coarse for (core/transport/pixels.py);
// with transport `diffusion` the equation of core/transport/diffusion/pixels.py. DETAIL: the surface has colours.
// Every output is weighted by u_weight and blended additively: the samples of a pixel add up to their mean.
#include "fresnel.glsl"
#include "bodies.glsl"
#include "detail_leaving.glsl"

uniform sampler2D t_position;   // rgb world, mm; a 1 where the object is
uniform sampler2D t_normal;     // a: body
uniform sampler2D t_irradiance; // a, as of the next two: what a thin slab's other side has in place of t_local's rgb
uniform sampler2D t_specular;
uniform sampler2D t_local;      // see irradiance_pixels.frag
uniform sampler3D t_exitance;   // at the nodes of the layers; the filter is the trilinear gather
uniform bool u_smooth;          // gather with quadratic B-splines instead of tents

uniform bool u_diffusion;
uniform vec3 u_diagonal;        // rho(0) / (2 A)
uniform vec3 u_doubled;         // 2 A
uniform sampler2D t_coupling;   // between the sides of a thin slab, over thickness; one row
uniform sampler3D t_depths;     // 1 / thickness, 1/mm, and how far it is a thin slab
uniform float u_thin_reach;     // thickness of the last texel, mm; 0: no part is thin
uniform bool u_bent;            // whether the next is other than 0
uniform sampler3D t_bending;    // A of a curved or thin surface over a flat one's, less 1
uniform sampler3D t_concentration;  // 1 / e, less 1: see core/transport/pixels.py
uniform sampler3D t_fluence;    // of the patches near each node, their mean

uniform sampler2D t_lobe;       // visible share of the highlight of an environment, see irradiance_pixels.frag
uniform bool u_occluded_lobe;   // whether it is there
uniform float u_surround_strength;  // see highlights.glsl
uniform bool u_fresnel;
uniform sampler2D t_seen_mirrored;  // what rays of sight found, see viewer/passes/composite.py; a: in place of rgb, the
uniform sampler2D t_seen_through;   // share of a ray that collides before it leaves the object
uniform sampler2D t_seen_scattered;
uniform bool u_traced;            // whether any were followed
uniform bool u_traced_inside;     // whether inside, too
uniform vec3 u_left_to_surface;   // share of exitance that they do not find
uniform float u_mirror_strength;
uniform mat4 u_world_to_clip;

uniform vec4 u_eye;             // homogeneous, see irradiance_pixels.frag
uniform float u_eta;
uniform float u_clear_from;  // number of the first body that scatters no light
uniform float u_exit_normalisation;  // N, sr
uniform float u_weight;         // 1 / samples of a pixel

layout(location = 0) out vec4 o_radiance;  // a: coverage
layout(location = 1) out vec4 o_position;
layout(location = 2) out vec4 o_normal;
layout(location = 3) out vec4 o_irradiance;
layout(location = 4) out vec4 o_exitance;
layout(location = 5) out vec4 o_subsurface;
layout(location = 6) out vec4 o_specular;
layout(location = 7) out vec4 o_unscattered;

// Sigg and Hadwiger 2005, Fast Third-Order Texture Filtering, of quadratic B-splines (TSC): 27 nodes by 8 filtered
// fetches, nodes i - 1 and i share one, i + 1 has its own.
vec4 gather_smooth(vec3 texture_coordinates) {
    vec3 size = vec3(textureSize(t_exitance, 0));
    vec3 u = texture_coordinates * size - 0.5;
    vec3 nearest = floor(u + 0.5), f = u - nearest;
    vec3 middle = 0.75 - f * f, upper = 0.5 * (0.5 + f) * (0.5 + f), lower = 1.0 - middle - upper;
    vec3 weights[2] = vec3[2](lower + middle, upper);
    vec3 positions[2] = vec3[2]((nearest - 0.5 + middle / (lower + middle)) / size, (nearest + 1.5) / size);
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 8; ++i) {
        int x = i & 1, y = (i >> 1) & 1, z = i >> 2;
        float weight = weights[x].x * weights[y].y * weights[z].z;
        sum += weight * textureLod(t_exitance, vec3(positions[x].x, positions[y].y, positions[z].z), 0.0);
    }
    return sum;
}

vec4 gather(vec3 coordinates) {
    return u_smooth ? gather_smooth(coordinates) : textureLod(t_exitance, coordinates, 0.0);
}

vec3 bending(vec3 coordinates) {
    return u_bent ? 1.0 + textureLod(t_bending, coordinates, 0.0).rgb : vec3(1.0);
}

// 1 / eigenvalue, smaller where it is weak.
vec3 damped_inverse(vec3 eigenvalue) {
    vec3 square = eigenvalue * eigenvalue;
    return eigenvalue * square / (square * square + pow(WEAK_EIGENVALUE, 4.0));
}

// Exitance of transport `diffusion`. entering: what light that enters here adds; entering_behind: on the other side.
// Solved for the excess of phi over the mean around here; of a thin slab the two sides' equations by their matrix's
// eigenvalues. core/transport/diffusion/points.py does the same in float64, by the same names.
vec3 diffuse_exitance(vec3 position, vec4 normal_and_body, vec3 coordinates, vec3 entering, vec3 entering_behind) {
    vec4 gathered = gather(coordinates);
    vec3 bend = bending(coordinates), mean = textureLod(t_fluence, coordinates, 0.0).rgb;
    vec3 diagonal = u_diagonal - bend * gathered.a, excess;
    vec2 depths = u_thin_reach > 0.0 ? textureLod(t_depths, coordinates, 0.0).rg : vec2(0.0);
    if (depths.y > 0.0) {
        float thickness = 1.0 / max(depths.x, 1.0 / u_thin_reach), columns = float(textureSize(t_coupling, 0).x);
        float s = (thickness / u_thin_reach * (columns - 1.0) + 0.5) / columns;
        vec4 coupling = depths.y * textureLod(t_coupling, vec2(s, 0.5), 0.0);
        vec3 behind = volume_coordinates(position - thickness * normal_and_body.xyz, normal_and_body.a);
        vec4 gathered_behind = gather(behind);
        vec3 bend_behind = bending(behind);
        vec3 diagonal_behind = u_diagonal - bend_behind * (gathered_behind.a + coupling.a);
        vec3 coupled = coupling.rgb + (bend_behind - 1.0) * coupling.a;
        vec3 coupled_behind = coupling.rgb + (bend - 1.0) * coupling.a;
        diagonal -= bend * coupling.a;
        vec3 rhs = gathered.rgb + entering - (diagonal + coupled) * mean;
        vec3 rhs_behind = gathered_behind.rgb + entering_behind - (diagonal_behind + coupled_behind) * mean;
        vec3 middle = 0.5 * (diagonal + diagonal_behind), half_difference = 0.5 * (diagonal - diagonal_behind);
        vec3 split = sqrt(max(half_difference * half_difference + coupled * coupled_behind, LEAST_SQUARED_SPLIT));
        vec3 upper = damped_inverse(middle + split), lower = damped_inverse(middle - split);
        vec3 slope = (upper - lower) / (2.0 * split);
        excess = (0.5 * (upper + lower) + slope * half_difference) * rhs + slope * coupled * rhs_behind;
    } else {
        excess = damped_inverse(diagonal) * (gathered.rgb + entering - diagonal * mean);
    }
    return (mean + excess) / u_doubled;
}

// M of the surface that a pixel shows.
vec3 exitance_at(ivec2 pixel, vec3 position, vec4 normal_and_body) {
    if (normal_and_body.a >= u_clear_from) return vec3(0.0);
    vec3 coordinates = volume_coordinates(position, normal_and_body.a);
    vec4 local = texelFetch(t_local, pixel, 0);
    vec3 behind = vec3(texelFetch(t_irradiance, pixel, 0).a, texelFetch(t_specular, pixel, 0).a, local.a);
    vec3 exitance = u_diffusion
        ? diffuse_exitance(position, normal_and_body, coordinates, local.rgb, behind)
        : gather(coordinates).rgb + local.rgb;
    return max(exitance, 0.0) * tint_leaving(pixel);  // the FFT leaves noise of 1e-7 of the maximum where it is dark
}

#include "mirrored_self.glsl"

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 position = texelFetch(t_position, pixel, 0);
    if (position.a == 0.0) discard;
    vec4 normal_and_body = texelFetch(t_normal, pixel, 0);
    if (!is_drawn(normal_and_body.a)) discard;
    vec3 normal = normal_and_body.xyz;
    vec4 irradiance = texelFetch(t_irradiance, pixel, 0), specular = texelFetch(t_specular, pixel, 0);
    vec3 exitance = exitance_at(pixel, position.xyz, normal_and_body);
    vec3 to_eye = normalize(u_eye.xyz - u_eye.w * position.xyz);
    // abs: interpolated normals may turn from the eye at a silhouette, which would draw a black outline
    float entering = fresnel_transmittance(u_eta, abs(dot(normal, to_eye)));
    vec4 seen_mirrored = vec4(0.0, 0.0, 0.0, 1.0), seen_through = seen_mirrored, seen_scattered = seen_mirrored;
    if (u_traced) seen_mirrored = texelFetch(t_seen_mirrored, pixel, 0);
    if (u_traced && u_traced_inside) {
        seen_through = texelFetch(t_seen_through, pixel, 0);
        seen_scattered = texelFetch(t_seen_scattered, pixel, 0);
    }
    vec3 shown = vec3(entering);
    if (u_traced_inside) {
        // M / e times what collides along the ray; where matter is thick that is F_t M (core/paths/tree.py).
        vec3 coordinates = volume_coordinates(position.xyz, normal_and_body.a);
        shown = 1.0 + textureLod(t_concentration, coordinates, 0.0).rgb;
        shown *= vec3(seen_mirrored.a, seen_through.a, seen_scattered.a);
    }
    vec3 subsurface = u_left_to_surface * shown * exitance / u_exit_normalisation + seen_scattered.rgb;
    vec3 highlight = specular.rgb + mirrored_self(pixel, position.xyz, normal, to_eye, entering, exitance);
    highlight += u_mirror_strength * seen_mirrored.rgb;
    vec3 unscattered = seen_through.rgb;
    o_radiance = u_weight * vec4(subsurface + highlight + unscattered, 1.0);
    o_position = u_weight * vec4(position.xyz, 1.0);
    o_normal = u_weight * vec4(normal, 1.0);
    o_irradiance = u_weight * vec4(irradiance.rgb, 1.0);
    o_exitance = u_weight * vec4(exitance, 1.0);
    o_subsurface = u_weight * vec4(subsurface, 1.0);
    o_specular = u_weight * vec4(highlight, 1.0);
    o_unscattered = u_weight * vec4(unscattered, 1.0);
}
