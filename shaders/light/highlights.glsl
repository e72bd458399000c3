// Phong 1975, Illumination for Computer Generated Pictures: highlights of one light at a pixel, the lobe max(0, r.l)^n
// about the mirrored eye ray r.
// u_fresnel is false for the paper's plain lobe, which is as bright whatever the exponent; a lobe of integral 1 is
// weighted with the reflectance F_r = 1 - F_t towards the eye, so that with strength 1 what is not mirrored enters.
// Needs irradiance.glsl.

uniform float u_shininess;          // n
uniform float u_lamp_strength;      // factor on irradiance * cos^n
uniform float u_surround_strength;  // factor on the lobe's mean radiance
uniform bool u_fresnel;
uniform sampler2D t_highlights;     // mean radiance of an environment in the lobe about every direction

float mirroring_eta;  // of the surface at this pixel

float mirrored(vec3 normal, vec3 to_eye) {
    // abs: interpolated normals may turn from the eye at a silhouette
    return u_fresnel ? 1.0 - fresnel_transmittance(mirroring_eta, abs(dot(normal, to_eye))) : 1.0;
}

// The tanh approximation of Page 1977.
float normal_distribution(float x) {
    return 0.5 + 0.5 * tanh(clamp(0.7978846 * x * (1.0 + 0.044715 * x * x), -10.0, 10.0));
}

vec3 lamp_highlight(Arrival arrival, vec3 normal, vec3 to_eye) {
    float lobe = max(0.0, dot(reflect(-to_eye, normal), arrival.to_light));
    // The lobe of a light below the horizon would shine through the surface.
    if (dot(normal, arrival.to_light) <= 0.0 || lobe <= 0.0) return vec3(0.0);
    // The lobe over all directions that it stands for, nearly: variances add (cos^n has 1 / n), and its integral stays.
    float exponent = u_shininess / (1.0 + u_shininess * arrival.spread);
    float weight = u_lamp_strength * mirrored(normal, to_eye) * (exponent + 1.0) / (u_shininess + 1.0);
    return weight * pow(lobe, exponent) * arrival.irradiance;
}

// Share of a lobe above the horizon where radiance is the same all around: int cos^n from -elevation to 90 degrees,
// over the same from -90 degrees; nearly the normal distribution. Within 0.014 for n >= 1.
float above_horizon(float sine) {
    return normal_distribution(asin(clamp(sine, -1.0, 1.0)) * sqrt(u_shininess + 0.5));
}

// lobe: what is visible of it, see highlights_vertices.vert.
vec3 environment_highlight(vec3 normal, vec3 to_eye, vec4 lobe) {
    vec3 mirror = reflect(-to_eye, normal);
    float weight = u_surround_strength * mirrored(normal, to_eye);
    if (!u_fresnel) weight *= above_horizon(dot(mirror, normal));  // else the lobe above has all of the integral
    weight *= clamp(lobe.a + dot(lobe.rgb, mirror), 0.0, 1.0);
    return weight * u_light_colour * latlong_table(t_highlights, u_environment_rotation * mirror);
}
