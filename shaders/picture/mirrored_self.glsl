// The object in its own mirror. Needs exitance_at(), is_drawn() and fresnel_transmittance(), the G-buffer t_position and
// t_normal, t_lobe and u_occluded_lobe, u_surround_strength, u_fresnel, u_eta, u_exit_normalisation and u_world_to_clip.

const int MIRROR_STEPS = 24, MIRROR_HALVINGS = 5;
const float ASIDE = 1.5;            // pixels
const float LEAST_FACING = 0.15;    // cosine up to which a surface is grazed
const float LEAST_MIRRORED = 0.15;  // reflectance from which on rays are followed, in full from twice as much on

// The pixel that shows what a ray from the surface meets, negative where none does: steps that grow, the first of which
// to end behind what is seen, by no more than its own length, is halved to where it meets it (McGuire and Mara 2014,
// Efficient GPU Screen-Space Ray Tracing). Rays that graze go on nearly as the eye's: what they meet is seen beside the
// silhouette, and so it is looked for aside of the ray, by more than a pixel, as one on the silhouette shows but itself.
// What it grazes itself mirrors it on, nearly straight. A ray that leaves the picture before it meets anything is taken to
// meet what it passes before there.
ivec2 met(vec3 position, vec3 normal, vec3 to_eye, vec3 ray) {
    vec2 size = vec2(textureSize(t_position, 0));
    vec4 start = u_world_to_clip * vec4(position, 1.0), onward = u_world_to_clip * vec4(ray, 0.0);
    vec4 across = u_world_to_clip * vec4(normal, 0.0);
    vec2 aside = size * (across.xy * start.w - start.xy * across.w);
    aside *= ASIDE / max(length(aside), 1e-20);
    float reach = (start.w - start.z) / max(onward.z - onward.w, 1e-20);  // to the far plane
    float low = 0.0, high = 0.0;
    ivec2 found = ivec2(-1), passed = ivec2(-1);
    for (int i = 1; i <= MIRROR_STEPS + MIRROR_HALVINGS; ++i) {
        float share = float(i) / float(MIRROR_STEPS);
        float next = found.x < 0 ? reach * share * share : 0.5 * (low + high);
        if (found.x < 0 && i > MIRROR_STEPS) break;
        vec4 clip = start + next * onward;
        vec2 pixel = (0.5 * clip.xy / clip.w + 0.5) * size + aside;
        if (clip.w <= 0.0 || any(lessThan(pixel, vec2(0.0))) || any(greaterThanEqual(pixel, size))) break;
        vec4 seen = texelFetch(t_position, ivec2(pixel), 0);
        float beyond = dot(seen.xyz - position - next * ray, to_eye);
        bool meets = seen.a > 0.0 && beyond > 0.0 && -dot(texelFetch(t_normal, ivec2(pixel), 0).xyz, ray) > LEAST_FACING;
        if (meets) found = ivec2(pixel);
        if (meets) high = next; else low = next;
        passed = seen.a > 0.0 && beyond <= 0.0 ? ivec2(pixel) : ivec2(-1);
    }
    return found.x < 0 ? passed : found;
}

// What a highlight mirrors of the object itself, else it had dark rims before itself: what a ray that grazes meets in
// the picture; and what is in the way of an environment besides, taken to be as bright as here.
vec3 mirrored_self(ivec2 pixel, vec3 position, vec3 normal, vec3 to_eye, float entering, vec3 exitance) {
    if (u_surround_strength == 0.0) return vec3(0.0);
    vec3 ray = reflect(-to_eye, normal), radiance = exitance / PI;
    float blocked = 0.0, mirrored = u_fresnel ? 1.0 - entering : 1.0;
    if (u_occluded_lobe) {
        vec4 lobe = texelFetch(t_lobe, pixel, 0);
        blocked = 1.0 - clamp(lobe.a + dot(lobe.rgb, ray), 0.0, 1.0);
    }
    float followed = u_fresnel ? smoothstep(LEAST_MIRRORED, 2.0 * LEAST_MIRRORED, mirrored) : 0.0;
    if (followed > 0.0) {
        ivec2 there = met(position, normal, to_eye, ray);
        vec4 facing = there.x < 0 ? vec4(-1.0) : texelFetch(t_normal, there, 0);
        if (is_drawn(facing.a)) {
            vec3 leaving = exitance_at(there, texelFetch(t_position, there, 0).xyz, facing);
            leaving *= fresnel_transmittance(u_eta, max(-dot(facing.xyz, ray), 0.0)) / u_exit_normalisation;
            radiance = mix(radiance, leaving, followed);
            blocked = u_occluded_lobe ? blocked : followed;
        }
    }
    return u_surround_strength * mirrored * blocked * radiance;
}
