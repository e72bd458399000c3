// Born and Wolf 1999, Principles of Optics, section 1.5: exact transmittance F_t = 1 - F_r of unpolarised light that
// enters or leaves a dielectric.
// eta: inside over outside. cosine: to the normal on the outside, [0, 1]. Returns [0, 1].
// Mirrors core/material/fresnel.py.
float fresnel_transmittance(float eta, float cosine) {
    if (eta == 1.0) return 1.0;  // no interface; at grazing incidence what follows would divide what is left of rounding
    float mu_i = clamp(cosine, 0.0, 1.0);
    float sin2_t = (1.0 - mu_i * mu_i) / (eta * eta);
    if (sin2_t >= 1.0 && eta < 1.0) return 0.0;
    float mu_t = sqrt(max(0.0, 1.0 - sin2_t));
    float perpendicular = (mu_i - eta * mu_t) / (mu_i + eta * mu_t);
    float parallel = (eta * mu_i - mu_t) / (eta * mu_i + mu_t);
    return 1.0 - 0.5 * (perpendicular * perpendicular + parallel * parallel);
}
