#version 330
// Wyman 2005, An Approximate Image-Space Approach for Interactive Refraction; here with several chords, for a draft of
// what rays of sight find (core/paths/tree.py): the inside is what lies between the nearest front and the nearest back
// of the surface at each pixel. A ray is refracted where it enters, leaves by Fresnel's share wherever it meets the
// surface from inside, and goes on mirrored; it gathers what glows along its chords. Light that leaves sees the
// surroundings, whatever of the object is in its way.
#include "fresnel.glsl"
#include "latlong.glsl"

uniform sampler2D t_position;  // of the front: rgb world, mm; a 1 where the object is
uniform sampler2D t_normal;
uniform sampler2D t_back;      // of the back, see back.frag
uniform sampler2D t_back_normal;
uniform vec4 u_depth;

uniform sampler2D t_whole;        // radiance of the environment, lat-long, all of it
uniform sampler2D t_even;         // and without strong sources, whose highlights are drawn by themselves
uniform mat3 u_environment_rotation;
uniform float u_environment_intensity;
uniform sampler2D t_floor;        // radiance of a plane below, see core/paths/surroundings.py
uniform float u_floor_height;
uniform vec2 u_floor_centre;
uniform vec2 u_floor_fade;
uniform vec2 u_floor_spread;      // spread, last; 0: there is no plane

uniform sampler3D t_glow;         // radiance that a mm scatters, at nodes
uniform sampler3D t_glow_x;       // what more of it goes along x, y and z
uniform sampler3D t_glow_y;
uniform sampler3D t_glow_z;
uniform mat4 u_world_to_glow;
uniform int u_glow_steps;         // 0: nothing glows
uniform bool u_directed;          // whether more of it goes one way than another

uniform mat4 u_world_to_clip;
uniform vec4 u_eye;               // homogeneous, see irradiance_pixels.frag
uniform vec4 u_bound;             // centre and radius of a ball around the object, mm
uniform float u_eta;
uniform vec3 u_extinction;        // 1/mm
uniform bool u_unscattered;       // whether what is seen through the object is shown

const int CHORDS = 4, STEPS = 5, HALVINGS = 2, PASSING_STEPS = 4;
const float SLACK = 2.0;          // pixels by which places may be before the front or behind the back
const float LEAST_FACING = 0.05;  // cosine of a surface that a ray leaves by
const float THIN = 1e-3;          // optical thickness of a step up to which 1 - e^-x is x
const float LEAST_MET = 0.15;     // cosine up to which a surface is grazed
const float LEAST_WEIGHT = 0.02;  // of what is mirrored inside; less leaves with the rest
const float NEGLIGIBLE = 1e-3;

layout(location = 0) out vec4 o_mirror;  // a, as of the next two: R, G and B of the share of the ray that collides
layout(location = 1) out vec4 o_unscattered;
layout(location = 2) out vec4 o_scattered;

vec3 surroundings(sampler2D environment, vec3 place, vec3 direction) {
    vec3 radiance = u_environment_intensity * textureLod(environment, latlong_uv(u_environment_rotation * direction), 0.0).rgb;
    if (u_floor_spread.x > 0.0 && direction.y < 0.0) {
        float along = (u_floor_height - place.y) / direction.y;
        vec2 off = place.xz + along * direction.xz - u_floor_centre;
        float gone = smoothstep(u_floor_fade.x, u_floor_fade.y, length(off));
        vec2 uv = 0.5 * asinh(off / u_floor_spread.x) / u_floor_spread.y + 0.5;
        if (along > 0.0 && gone < 1.0) radiance = mix(textureLod(t_floor, uv, 0.0).rgb, radiance, gone);
    }
    return radiance;
}

// A ray as pixels show it.
struct Way {
    vec4 clip, clip_onward;
    float depth, deeper;
    float reach;  // mm, out of the ball around the object
    float slack;  // mm
};

Way way_of(vec3 start, vec3 ray) {
    vec3 off = start - u_bound.xyz;
    float across = dot(off, ray);
    float reach = -across + sqrt(max(across * across - dot(off, off) + u_bound.w * u_bound.w, 0.0));
    vec3 right = vec3(u_world_to_clip[0].x, u_world_to_clip[1].x, u_world_to_clip[2].x);
    vec4 clip = u_world_to_clip * vec4(start, 1.0);
    float slack = SLACK * clip.w / (0.5 * float(textureSize(t_back, 0).x) * length(right));
    return Way(clip, u_world_to_clip * vec4(ray, 0.0), dot(u_depth, vec4(start, 1.0)), dot(u_depth.xyz, ray), reach, slack);
}

// What t_back has at the pixel that shows a ray at a length, and how far it is there below the front and the back.
vec4 seen_at(Way way, float size, out ivec2 pixel, out vec2 below) {
    vec2 pixels = vec2(textureSize(t_back, 0));
    vec4 there = way.clip + size * way.clip_onward;
    pixel = ivec2(clamp((0.5 * there.xy / there.w + 0.5) * pixels, vec2(0.0), pixels - 1.0));
    vec4 seen = texelFetch(t_back, pixel, 0);
    float depth = way.depth + size * way.deeper;
    below = seen.a > 0.0 ? vec2(depth - seen.a, dot(u_depth, vec4(seen.xyz, 1.0)) - depth) : vec2(-1e20);
    return seen;
}

// Length of the chord of a ray that starts at the surface; normal of where it ends, outward.
float chord(vec3 start, vec3 ray, out vec3 normal) {
    Way way = way_of(start, ray);
    float low = 0.0, high = 0.0;
    ivec2 pixel, within;
    vec2 below, inner;
    vec4 back = seen_at(way, 0.0, within, inner);
    for (int i = 1; i <= STEPS + HALVINGS; ++i) {
        float share = float(i) / float(STEPS);
        float next = high > 0.0 ? 0.5 * (low + high) : way.reach * share * share;
        vec4 seen = seen_at(way, next, pixel, below);
        if (min(below.x, below.y) > -way.slack) {
            low = next;
            within = pixel;
            inner = below;
            back = seen;
        } else {
            high = next;
        }
        if (high == 0.0 && i >= STEPS) break;
    }
    bool by_back = inner.y <= inner.x;
    vec3 place = by_back ? back.xyz : texelFetch(t_position, within, 0).xyz;
    normal = by_back ? texelFetch(t_back_normal, within, 0).xyz : texelFetch(t_normal, within, 0).xyz;
    float facing = dot(normal, ray);
    if (facing < LEAST_FACING) {
        normal = normalize(normal + (LEAST_FACING - facing) * ray);
        return 0.5 * (low + high);
    }
    return clamp(dot(place - start, normal) / facing, low, max(low, high));
}

// What the object leaves of light that comes to the surface from outside, past or through other parts of it.
vec3 left_past(vec3 start, vec3 ray) {
    Way way = way_of(start, ray);
    ivec2 pixel;
    vec2 below;
    for (int i = 1; i <= PASSING_STEPS; ++i) {
        float share = float(i) / float(PASSING_STEPS);
        seen_at(way, way.reach * share * share, pixel, below);
        if (min(below.x, below.y) <= way.slack) continue;
        vec3 facing = below.y < below.x ? texelFetch(t_back_normal, pixel, 0).xyz : texelFetch(t_normal, pixel, 0).xyz;
        if (dot(facing, ray) < -LEAST_MET) return exp(-u_extinction * (below.x + below.y));
    }
    return vec3(1.0);
}

vec3 glow(vec3 start, vec3 ray, float size, int steps, inout vec3 weight) {
    vec3 gathered = vec3(0.0), step_size = vec3(size / float(steps));
    vec3 thickness = u_extinction * step_size, kept = exp(-thickness);
    vec3 counted = mix(step_size, (1.0 - kept) / max(u_extinction, 1e-20), greaterThan(thickness, vec3(THIN)));
    for (int i = 0; i < steps; ++i) {
        vec3 place = start + (float(i) + 0.5) * step_size.x * ray;
        vec3 coordinates = (u_world_to_glow * vec4(place, 1.0)).xyz;
        vec3 value = textureLod(t_glow, coordinates, 0.0).rgb;
        if (u_directed) {
            value -= ray.x * textureLod(t_glow_x, coordinates, 0.0).rgb;
            value -= ray.y * textureLod(t_glow_y, coordinates, 0.0).rgb;
            value -= ray.z * textureLod(t_glow_z, coordinates, 0.0).rgb;
        }
        gathered += weight * counted * max(value, 0.0);
        weight *= kept;
    }
    return gathered / (u_eta * u_eta);
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 position = texelFetch(t_position, pixel, 0);
    if (position.a == 0.0) discard;
    vec3 place = position.xyz, onward = normalize(u_eye.w * place - u_eye.xyz);
    vec3 normal = texelFetch(t_normal, pixel, 0).xyz;
    normal -= 2.0 * max(dot(normal, onward), 0.0) * onward;  // as of core/paths/tree.py
    float entering = fresnel_transmittance(u_eta, -dot(normal, onward));
    vec3 mirrored = reflect(onward, normal);
    o_mirror = vec4((1.0 - entering) * left_past(place, mirrored) * surroundings(t_even, place, mirrored), 1.0);
    vec3 weight = vec3(entering), unscattered = vec3(0.0), scattered = vec3(0.0), collided = vec3(0.0);
    vec3 ray = refract(onward, normal, 1.0 / u_eta);
    int steps = u_glow_steps;
    for (int i = 1; i <= CHORDS; ++i) {
        vec3 outward;
        float size = chord(place, ray, outward);
        collided += weight * (1.0 - exp(-u_extinction * size));
        if (steps > 0) scattered += glow(place, ray, size, steps, weight);
        else weight *= exp(-u_extinction * size);
        if (steps > 1) steps /= 2;
        place += size * ray;
        vec3 leaving = refract(ray, -outward, u_eta);
        float share = dot(leaving, leaving) > 0.0 ? fresnel_transmittance(1.0 / u_eta, dot(ray, outward)) : 0.0;
        if (share > 0.0 && (1.0 - share) * max(weight.r, max(weight.g, weight.b)) < LEAST_WEIGHT) share = 1.0;
        if (i == CHORDS) {  // the rest of it leaves
            share = 1.0;
            leaving = dot(leaving, leaving) > 0.0 ? leaving : ray;
        }
        if (u_unscattered && share > 0.0) {
            vec3 seen = surroundings(t_whole, place, leaving);
            if (i == 1) seen *= left_past(place, leaving);
            unscattered += weight * share * seen;
        }
        weight *= 1.0 - share;
        if (max(weight.r, max(weight.g, weight.b)) < NEGLIGIBLE) break;
        ray = reflect(ray, outward);
    }
    o_mirror.a = collided.r;
    o_unscattered = vec4(unscattered, collided.g);
    o_scattered = vec4(scattered, collided.b);
}
