// With the switch SOFT in place of arrival.glsl: a light with a size as sub-lights, equal shares of it; and the cone of
// a spot light. Mirrors viewer/scene/lights/sub_lights.py.
#include "shadows_soft.glsl"

uniform int u_sub_lights;
uniform ivec2 u_part;          // the first one to be seen, and how many on is the next, a divisor of their number
// SHAPE_EVEN: a disc far away. SHAPE_SPHERE: of even radiance. SHAPE_FACE: radiates by the cosine to u_light_axis,
// before it only. SHAPE_CONE: fades from u_cone.y to u_cone.x, cosines to u_light_axis. SHAPE_BALL: a sphere in patches,
// which radiate by the cosine to its surface.
uniform int u_light_shape;
uniform vec3 u_light_axis;     // unit, the way that most light goes
uniform vec2 u_cone;
uniform float u_light_radius;  // of a SHAPE_SPHERE or a SHAPE_BALL, mm; of a SHAPE_EVEN radians, 0: no disc of known size

int first_sub_light() { return u_part.x; }
int next_sub_light(int i) { return i + u_part.y; }
int sub_lights() { return u_sub_lights; }

float emission(vec3 position, vec3 to_light, float distance2) {
    float along = -dot(to_light, u_light_axis);
    if (u_light_shape == SHAPE_FACE) return max(along, 0.0) / distance2;
    if (u_light_shape == SHAPE_BALL) {
        vec3 normal = (position + sqrt(distance2) * to_light - u_light_vector) / u_light_radius;
        return 4.0 * max(-dot(to_light, normal), 0.0) / distance2;
    }
    if (u_light_shape == SHAPE_CONE) return smoothstep(u_cone.x, u_cone.y, along) / distance2;
    // A sphere's directions fill a cone of half angle a, sin a = R / d, evenly, and I / d^2 = L pi sin^2 a is what
    // enters with their cosines: 2 (1 - cos a) / sin^2 a as much without them.
    vec3 to_centre = u_light_vector - position;
    float centre2 = max(dot(to_centre, to_centre), u_light_radius * u_light_radius);
    return 2.0 / (1.0 + sqrt(1.0 - u_light_radius * u_light_radius / centre2)) / centre2;
}

Disc disc_of_light(vec3 position) {
    if (u_light_kind != LIGHT_POINT) {
        float solid_angle = 2.0 * PI * (1.0 - cos(u_light_radius));
        return Disc(u_light_vector, u_light_radius, u_light_colour / max(solid_angle, 1e-20));
    }
    vec3 to_centre = u_light_vector - position;
    float distance = length(to_centre);
    if (u_light_shape == SHAPE_FACE || u_light_shape == SHAPE_CONE || distance <= u_light_radius)
        return Disc(vec3(0.0), 0.0, vec3(0.0));
    float face = PI * u_light_radius * u_light_radius;
    return Disc(to_centre / distance, asin(u_light_radius / distance), u_light_colour / max(face, 1e-20));
}

Arrival unshadowed(int i, vec3 position) {
    // Variance of an even disc: 1/4 of its radius^2. Of one of many sub-lights u_piece is half the radius, and thrice
    // the variance makes the highlights of neighbours merge.
    float spread = (u_sub_lights > 1 ? 3.0 : 0.25) * u_piece * u_piece;
    vec3 place = sub_light(i).xyz;
    vec3 share = float(u_part.y) / float(u_sub_lights) * u_light_colour;
    if (u_light_kind != LIGHT_POINT) return Arrival(place, share, 1.0, spread);
    vec3 to_light = place - position;
    float distance2 = max(dot(to_light, to_light), NEAREST_LIGHT * NEAREST_LIGHT);
    float distance = sqrt(distance2);
    to_light /= distance;
    return Arrival(to_light, emission(position, to_light, distance2) * share, distance, spread / distance2);
}

Arrival arrive(int i, vec3 position, vec3 normal) {
    Arrival arrival = unshadowed(i, position);
    if (dot(normal, arrival.to_light) > 0.0 && arrival.irradiance != vec3(0.0))
        arrival.irradiance *= soft_visibility(i, position, normal, arrival.to_light);
    return arrival;
}
