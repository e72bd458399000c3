// What of a light is known at a place.

// What arrives from a light, or from one of the sub-lights of a light with a size.
struct Arrival {
    vec3 to_light;
    vec3 irradiance;  // on a surface that faces it
    float distance;   // to it, mm; 1 of a directional light
    float spread;     // variance of the directions that it stands for, radians^2
};

// The disc that a light shows, of even radiance; a radius of 0 where it shows none.
struct Disc {
    vec3 to_centre;
    float radius;    // radians
    vec3 radiance;
};
