#version 330
// Visible share of an environment's highlight at every vertex: 1 - blocked / above the horizon, both under Phong's lobe
// about the mirrored eye ray (core/light/visibility.py), and how it changes as the ray turns. A G-buffer interpolates
//     v_lobe.a + v_lobe.rgb . r,
// so that between vertices, and where the surface is bent, the share is of the pixel's own mirrored ray r.
#include "gbuffer.glsl"

uniform sampler2D t_blocked;  // coefficients of each vertex, texels below one another: viewer/passes/highlights.py
uniform int u_order;
uniform int u_texels;                     // of a vertex
uniform float u_bands[LOBE_ORDER + 1];    // of the lobe: factor of each band
uniform float u_horizon[LOBE_ORDER + 1];  // the lobe's share above a horizon, over P_l(sine of the elevation)
uniform vec4 u_eye;                       // homogeneous, see irradiance_pixels.frag

in vec3 a_position;
in vec3 a_normal;
out vec4 v_lobe;

const float STEP = 0.15;      // radians between the rays that the change is of

// Of three directions at once, by the recurrences of P_lm / (sin^m (2m - 1)!!) and of sin^m (cos m phi, sin m phi).
vec3 shares(vec3 x, vec3 y, vec3 z, vec3 sine) {
    int width = textureSize(t_blocked, 0).x;
    ivec2 first = ivec2(gl_VertexID % width, gl_VertexID / width * u_texels);
    vec3 blocked = vec3(0.0), cosines = vec3(1.0), sines = vec3(0.0);
    vec4 pairs = vec4(0.0);
    for (int m = 0, i = 0; m <= u_order; ++m) {
        vec3 older = vec3(0.0), legendre = vec3(1.0);
        for (int l = m; l <= u_order; ++l, ++i) {
            pairs = i % 2 == 0 ? texelFetch(t_blocked, first + ivec2(0, i / 2), 0) : pairs.zwzw;
            blocked += u_bands[l] * legendre * (pairs.x * cosines + pairs.y * sines);
            vec3 next = (float(2 * l + 1) * y * legendre - float(l + m) * older) / float(l + 1 - m);
            older = legendre;
            legendre = next;
        }
        vec3 turned = -z * cosines - x * sines;
        sines = x * cosines - z * sines;
        cosines = turned;
    }
    vec3 above = vec3(0.0), older = vec3(0.0), legendre = vec3(1.0);
    for (int l = 0; l <= u_order; ++l) {
        above += u_horizon[l] * legendre;
        vec3 next = (float(2 * l + 1) * sine * legendre - float(l) * older) / float(l + 1);
        older = legendre;
        legendre = next;
    }
    return clamp(1.0 - blocked / max(above, MIN_LOBE), 0.0, 1.0);
}

void main() {
    vec3 normal = unit_normal(a_normal), to_eye = normalize(u_eye.xyz - u_eye.w * a_position);
    float facing = dot(normal, to_eye);
    v_lobe = vec4(0.0, 0.0, 0.0, 1.0);
    if (facing < -0.3) return;  // far round the back
    // A vertex just behind a silhouette counts for pixels before it: as seen along its horizon.
    if (facing < 0.0) to_eye = normalize(to_eye - facing * normal);
    vec3 ray = reflect(-to_eye, normal);
    vec3 s = normalize(cross(abs(ray.y) < 0.7 ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0), ray)), t = cross(ray, s);
    vec3 a = normalize(ray + STEP * s), b = normalize(ray + STEP * t);
    vec3 share = shares(vec3(ray.x, a.x, b.x), vec3(ray.y, a.y, b.y), vec3(ray.z, a.z, b.z),
                        vec3(dot(ray, normal), dot(a, normal), dot(b, normal)));
    vec3 change = ((share.y - share.x) * s + (share.z - share.x) * t) / STEP;
    v_lobe = vec4(change, share.x - dot(change, ray));
}
