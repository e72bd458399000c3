// Irradiance that enters the surface, (2): E = integral of F_t L cos over the hemisphere, for one light.
// Surface samples and pixels call the same function.
#include "fresnel.glsl"
#include "latlong.glsl"
#include "arriving.glsl"

// LIGHT_DIRECTIONAL: u_light_vector: unit, towards the light; u_light_colour: irradiance at normal incidence.
// LIGHT_POINT: u_light_vector: position, mm; u_light_colour: radiant intensity, E = I cos / d^2, d in mm.
// LIGHT_ENVIRONMENT: t_environment: E over normals, F_t included; u_light_colour: factor.
// LIGHT_REENTERING: known at pixels alone, see irradiance_pixels.frag.
uniform int u_light_kind;
uniform vec3 u_light_vector;
uniform vec3 u_light_colour;
uniform mat3 u_environment_rotation;  // world to probe
uniform sampler2D t_environment;
uniform float u_eta;

#ifdef SOFT
#include "arrival_soft.glsl"
#else
#include "arrival.glsl"
#endif

// Irradiance of an arrival on a surface; linear RGB, same unit as the light's.
vec3 entering(Arrival arrival, vec3 normal) {
    float cosine = max(0.0, dot(normal, arrival.to_light));
    return fresnel_transmittance(u_eta, cosine) * cosine * arrival.irradiance;
}

vec3 environment_irradiance(vec3 normal) {
    return u_light_colour * latlong_table(t_environment, u_environment_rotation * normal);
}
