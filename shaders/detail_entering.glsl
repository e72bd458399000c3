// What the colours and the relief of a surface do to light that enters at a pixel.
#include "detail.glsl"

uniform sampler2D t_shading;
uniform float u_before;           // power of the colour on irradiance
uniform sampler3D t_near_colour;  // to that power, of the surface near each node: for other sides of sheets
uniform mat4 u_world_to_near;

vec3 colour_near(vec3 position) {
    return textureLod(t_near_colour, (u_world_to_near * vec4(position, 1.0)).xyz, 0.0).rgb;
}

// Normal that light meets and, in a, a factor on irradiance.
vec4 shading_normal(ivec2 pixel, vec3 normal) {
    return u_detailed ? texelFetch(t_shading, pixel, 0) : vec4(normal, 1.0);
}

// Fades light out where it falls below the surface's own horizon, without an edge (Chiang, Li and Burley 2019);
// 1 where both normals are the same.
float above_surface(vec3 normal, vec3 shading, vec3 to_light) {
    float own = dot(normal, to_light), turned = dot(shading, to_light) * dot(normal, shading);
    if (own <= 0.0 || turned <= 0.0) return 0.0;
    float g = min(own / turned, 1.0);
    return g * (1.0 + g * (1.0 - g));
}
