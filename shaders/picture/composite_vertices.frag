#version 330
// Radiance towards the eye as composite.frag has it, while something moves: from exitance and visible shares of lamps
// that are known at the vertices. The highlight of a lamp with a size is that of one lobe or disc.
#include "fresnel.glsl"
#include "latlong.glsl"
#include "arriving.glsl"
#include "visible.glsl"

uniform float u_eta;
uniform vec3 u_light_colour;          // factor on the environment
uniform mat3 u_environment_rotation;  // world to probe

#include "highlights.glsl"
#include "highlights_discs.glsl"

uniform vec2 u_bodies;         // as in bodies.glsl
uniform sampler2D t_position;  // rgb world, mm; a where the object is 1 and the shares of the last three lamps
uniform sampler2D t_normal;    // a: body
uniform sampler2D t_lit;       // rgb exitance; a: shares of the first three lamps
uniform sampler2D t_lobe;      // visible share of the highlight of an environment, see highlights_vertices.vert
uniform bool u_occluded_lobe;  // whether it is there
uniform bool u_surrounded;     // whether there is an environment
uniform int u_lamps;
uniform vec4 u_lamp_places[MOST_LAMPS];   // homogeneous: (place, 1), mm, or (direction towards the lamp, 0)
uniform vec3 u_lamp_colours[MOST_LAMPS];  // radiant intensity, or irradiance on what faces it
uniform float u_lamp_radii[MOST_LAMPS];   // mm or radians; 0: sharp
uniform mat4 u_world_to_clip;
uniform vec4 u_eye;            // homogeneous, see irradiance_pixels.frag
uniform float u_exit_normalisation;

layout(location = 0) out vec4 o_radiance;  // a: coverage

bool is_drawn(float body) { return body >= u_bodies.x && body < u_bodies.y; }

vec3 exitance_at(ivec2 pixel, vec3 position, vec4 normal_and_body) { return texelFetch(t_lit, pixel, 0).rgb; }

#include "mirrored_self.glsl"

// Highlight of a whole lamp that nothing is in the way of.
vec3 highlight_of(int lamp, vec3 position, vec3 normal, vec3 to_eye) {
    vec4 place = u_lamp_places[lamp];
    vec3 to_lamp = place.xyz - place.w * position;
    float distance = max(length(to_lamp), NEAREST_LIGHT), size = u_lamp_radii[lamp];
    to_lamp /= distance;
    float radius = place.w > 0.0 ? asin(min(size / distance, 1.0)) : size;
    float face = place.w > 0.0 ? PI * size * size : 2.0 * PI * (1.0 - cos(size));
    Disc disc = Disc(to_lamp, radius, u_lamp_colours[lamp] / max(face, 1e-20));
    // Variance of an even disc: 1/4 of its radius^2.
    Arrival whole = Arrival(to_lamp, u_lamp_colours[lamp] / (distance * distance), distance, 0.25 * radius * radius);
    Image image = image_of_disc(disc, normal, to_eye);
    return mix(lamp_highlight(whole, normal, to_eye), image.radiance, image.share);
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 position = texelFetch(t_position, pixel, 0);
    if (position.a == 0.0) discard;
    vec4 normal_and_body = texelFetch(t_normal, pixel, 0), lit = texelFetch(t_lit, pixel, 0);
    if (!is_drawn(normal_and_body.a)) discard;
    vec3 normal = normal_and_body.xyz, to_eye = normalize(u_eye.xyz - u_eye.w * position.xyz);
    mirroring_eta = u_eta;
    float leaving = fresnel_transmittance(u_eta, abs(dot(normal, to_eye)));  // abs: as in composite.frag
    vec3 highlight = mirrored_self(pixel, position.xyz, normal, to_eye, leaving, lit.rgb);
    vec3 first = unpacked_share(lit.a), last = unpacked_share(position.a - 1.0);
    for (int i = 0; i < u_lamps; ++i)
        highlight += (i < 3 ? first[i] : last[i - 3]) * highlight_of(i, position.xyz, normal, to_eye);
    if (u_surrounded) {
        vec4 lobe = u_occluded_lobe ? texelFetch(t_lobe, pixel, 0) : vec4(0.0, 0.0, 0.0, 1.0);
        highlight += environment_highlight(normal, to_eye, lobe);
    }
    o_radiance = vec4(leaving * lit.rgb / u_exit_normalisation + highlight, 1.0);
}
