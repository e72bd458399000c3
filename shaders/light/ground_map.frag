#version 330
// Irradiance on the plane that the object stands on that is known at the places of maps (core/light/ground.py): of lights
// with a size, with the object in their way and without, and from all around, with what leaves the object.

uniform sampler2D t_place;       // of ground_place.frag
uniform sampler2D t_lamps;       // E of lights with a size
uniform sampler2D t_open_lamps;  // the same in the open
uniform sampler2D t_around;      // E from all around
uniform vec3 u_open_around;      // the same in the open
uniform vec2 u_centre;           // of the maps, x and z, mm
uniform float u_spread;          // mm: places are at centre + spread sinh(u last)
uniform float u_last;

layout(location = 0) out vec4 o_lit;
layout(location = 1) out vec4 o_open;

// Quadratic B-splines, as gather_smooth of composite.frag: 9 texels by 4 filtered fetches. place: in [0, 1].
vec3 smooth_map(sampler2D map, vec2 place) {
    vec2 size = vec2(textureSize(map, 0)), u = place * size - 0.5;
    vec2 nearest = floor(u + 0.5), f = u - nearest;
    vec2 middle = 0.75 - f * f, upper = 0.5 * (0.5 + f) * (0.5 + f), lower = 1.0 - upper;
    vec2 first = (nearest - 0.5 + middle / lower) / size, second = (nearest + 1.5) / size;
    return lower.x * lower.y * textureLod(map, first, 0.0).rgb
        + upper.x * lower.y * textureLod(map, vec2(second.x, first.y), 0.0).rgb
        + lower.x * upper.y * textureLod(map, vec2(first.x, second.y), 0.0).rgb
        + upper.x * upper.y * textureLod(map, second, 0.0).rgb;
}

void main() {
    vec4 place = texelFetch(t_place, ivec2(gl_FragCoord.xy), 0);
    if (place.a == 0.0) discard;
    vec2 uv = 0.5 * asinh((place.xz - u_centre) / u_spread) / u_last + 0.5;
    o_lit = vec4(smooth_map(t_lamps, uv) + smooth_map(t_around, uv), 0.0);
    o_open = vec4(smooth_map(t_open_lamps, uv) + u_open_around, 0.0);
}
