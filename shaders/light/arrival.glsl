// What arrives from a directional or point light, sharp: it is its only sub-light. Included by irradiance.glsl.
#include "shadows.glsl"

int first_sub_light() { return 0; }
int next_sub_light(int i) { return i + 1; }
int sub_lights() { return 1; }

// Regardless of shadows; position: world, mm.
Arrival unshadowed(int i, vec3 position) {
    if (u_light_kind != LIGHT_POINT) return Arrival(u_light_vector, u_light_colour, 1.0, 0.0);
    vec3 to_light = u_light_vector - position;
    // A light on the surface itself would be infinitely bright; NEAREST_LIGHT is nearer than any scene means.
    float distance = max(length(to_light), NEAREST_LIGHT);
    return Arrival(to_light / distance, u_light_colour / (distance * distance), distance, 0.0);
}

// position: world, mm; normal: unit, outward. Not for LIGHT_ENVIRONMENT.
Arrival arrive(int i, vec3 position, vec3 normal) {
    Arrival arrival = unshadowed(i, position);
    if (dot(normal, arrival.to_light) > 0.0)
        arrival.irradiance *= shadow_visibility(position, normal, arrival.to_light, arrival.distance);
    return arrival;
}
