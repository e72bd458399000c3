// A lamp at a pixel: the sum over its sub-lights. Needs irradiance.glsl, sheet.glsl, highlights.glsl and
// detail_entering.glsl.

struct Lamplight {
    vec3 irradiance;  // E that enters
    vec3 specular;
    float cosine;     // of the light to the normal; the mean of what enters
    Behind behind;    // likewise
};

float brightness(vec3 colour) { return colour.r + colour.g + colour.b; }

// shading: normal that light meets, and what relief leaves of it.
Lamplight lamplight(vec3 position, vec3 normal, vec4 shading, vec3 to_eye, float body) {
    Lamplight sum = Lamplight(vec3(0.0), vec3(0.0), 0.0, Behind(vec3(0.0), 0.0, 0.0));
#ifdef SOFT
    Image image = image_of_light(position, shading.xyz, to_eye);
    bool shows = any(greaterThan(image.radiance, vec3(0.0)));
    vec3 whole = vec3(0.0);  // highlight without what is in the way, by which the image is visible
#endif
    for (int i = first_sub_light(); i < sub_lights(); i = next_sub_light(i)) {
        Arrival arrival = arrive(i, position, normal);
        float cosine = dot(normal, arrival.to_light);
        if (cosine > 0.0) {
            float above = above_surface(normal, shading.xyz, arrival.to_light);
            vec3 irradiance = above * shading.a * entering(arrival, shading.xyz);
            sum.irradiance += irradiance;
            sum.cosine += brightness(irradiance) * cosine;
            sum.specular += above * lamp_highlight(arrival, shading.xyz, to_eye);
#ifdef SOFT
            if (shows) whole += lamp_highlight(unshadowed(i, position), shading.xyz, to_eye);
#endif
        } else if (u_sheet_reach > 0.0) {
            Behind one = light_behind(i, position, normal, arrival.to_light, body);
            float weight = brightness(one.irradiance);
            sum.behind.irradiance += one.irradiance;
            sum.behind.thickness += weight * one.thickness;
            sum.behind.cosine += weight * one.cosine;
        }
    }
#ifdef SOFT
    sum.specular = mix(sum.specular, image.radiance * sum.specular / max(whole, vec3(1e-20)), image.share);
#endif
    // Where nothing enters they multiply nothing, but 0/0 would become NaN.
    sum.cosine /= max(brightness(sum.irradiance), 1e-20);
    float weight = max(brightness(sum.behind.irradiance), 1e-20);
    sum.behind.thickness /= weight;
    sum.behind.cosine /= weight;
    return sum;
}
