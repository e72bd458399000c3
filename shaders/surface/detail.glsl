// What a surface without colours and relief does; detail_entering.glsl and detail_leaving.glsl, included before, do more.
#ifndef DETAIL
#define shading_normal(pixel, normal) vec4(normal, 1.0)
#define above_surface(normal, shading, to_light) 1.0
#define tint_entering(pixel) vec3(1.0)
#define tint_behind(position) vec3(1.0)
#define tint_leaving(pixel) vec3(1.0)
#endif
