// Born and Wolf 1999, Principles of Optics, section 1.5: exact transmittance F_t = 1 - F_r of unpolarised light that
// enters or leaves a dielectric.
// eta: inside over outside. cosine: to the normal on the outside, [0, 1]. Returns [0, 1].
// Mirrors core/material/fresnel.py.
float fresnel_transmittance(float eta, float cosine) {
    float mu_i = clamp(cosine, 0.0, 1.0);
    float sin2_t = (1.0 - mu_i * mu_i) / (eta * eta);
    if (sin2_t >= 1.0 && eta < 1.0) return 0.0;
    float mu_t = sqrt(max(0.0, 1.0 - sin2_t));
    // The guard is for eta = 1 at grazing incidence, 0/0: no interface, nothing reflects.
    float perpendicular = (mu_i - eta * mu_t) / max(mu_i + eta * mu_t, 1e-20);
    float parallel = (eta * mu_i - mu_t) / max(eta * mu_i + mu_t, 1e-20);
    return 1.0 - 0.5 * (perpendicular * perpendicular + parallel * parallel);
}
