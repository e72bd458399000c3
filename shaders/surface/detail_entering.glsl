// What the colours and the relief of a surface do to light that enters at a pixel: nothing without the switch DETAIL.

#ifdef DETAIL
uniform sampler2D t_colour;       // of detail.frag
uniform sampler2D t_shading;
uniform float u_before;           // power of the colour on irradiance
uniform sampler3D t_near_colour;  // to that power, of the surface near each node: for other sides of thin slabs
uniform mat4 u_world_to_near;

// Normal that light meets and, in a, a factor on irradiance.
vec4 shading_normal(ivec2 pixel, vec3 normal) {
    return texelFetch(t_shading, pixel, 0);
}

// Factor on light that relief turns towards, so that it fades out, without an edge, where it falls below the surface's
// own horizon: the cosine is at most a few times the surface's own. 1 where both normals are the same.
float above_surface(vec3 normal, vec3 shading, vec3 to_light) {
    const float LARGEST_RATIO = 4.0;
    return clamp(LARGEST_RATIO * dot(normal, to_light) / max(dot(shading, to_light), 1e-6), 0.0, 1.0);
}

vec3 tint_entering(ivec2 pixel) {
    return u_before > 0.0 ? pow(texelFetch(t_colour, pixel, 0).rgb, vec3(u_before)) : vec3(1.0);
}

vec3 tint_behind(vec3 position) {
    return textureLod(t_near_colour, (u_world_to_near * vec4(position, 1.0)).xyz, 0.0).rgb;
}
#else
vec4 shading_normal(ivec2 pixel, vec3 normal) { return vec4(normal, 1.0); }

float above_surface(vec3 normal, vec3 shading, vec3 to_light) { return 1.0; }

vec3 tint_entering(ivec2 pixel) { return vec3(1.0); }

vec3 tint_behind(vec3 position) { return vec3(1.0); }
#endif
