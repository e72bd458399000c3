// Highlights of lights that show a disc wider than the edges of what is mirrored: its image. Needs highlights.glsl.

uniform float u_edge;  // radians, deviation of the edges of discs that are mirrored; 0: lights have lobes alone
uniform float u_disc_from;  // radians, radius from which on discs show, whole from twice as much on
uniform bool u_discs_by_rays;  // whether rays of sight show them

// Image of a light that is mirrored as a disc, and how far it is one: 0 of a light that has a lobe alone.
struct Image {
    vec3 radiance;
    float share;
};

// Of a disc wider than the edges of what is mirrored, all of it seen. A lobe is nearly normal with a variance of 1 / n,
// so that across a straight edge there is the normal distribution.
Image image_of_disc(Disc disc, vec3 normal, vec3 to_eye) {
    if (u_edge == 0.0) return Image(vec3(0.0), 0.0);
    float share = smoothstep(u_disc_from, 2.0 * u_disc_from, disc.radius);
    vec3 ray = reflect(-to_eye, normal);
    float angle = 2.0 * asin(0.5 * length(ray - disc.to_centre));
    float inside = share > 0.0 && !u_discs_by_rays ? normal_distribution((disc.radius - angle) / u_edge) : 0.0;
    float weight = u_lamp_strength * 2.0 * PI / (u_shininess + 1.0) * mirrored(normal, to_eye);
    return Image(weight * inside * disc.radiance, share);
}

#ifdef SOFT
Image image_of_light(vec3 position, vec3 normal, vec3 to_eye) {
    return image_of_disc(disc_of_light(position), normal, to_eye);
}
#endif
