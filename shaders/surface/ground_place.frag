#version 330
// Where the plane that the object stands on is seen, from above alone: its place, and how far it is there. The object is
// above it, and so before it, wherever both are.
uniform mat4 u_clip_to_world;
uniform vec4 u_depth;    // of a place in homogeneous world space, > 0 before the eye
uniform float u_height;  // y of the plane, mm
uniform vec2 u_centre;   // x and z, mm
uniform vec2 u_fade;     // distances from there between which it fades away, mm
uniform vec2 u_size;     // pixels

out vec4 o_place;        // rgb world, mm; a share of the plane

void main() {
    vec2 clip = 2.0 * gl_FragCoord.xy / u_size - 1.0;
    vec4 near = u_clip_to_world * vec4(clip, -1.0, 1.0), far = u_clip_to_world * vec4(clip, 1.0, 1.0);
    vec3 start = near.xyz / near.w, along = far.xyz / far.w - start;
    if (along.y >= 0.0) discard;
    vec3 place = start + (u_height - start.y) / along.y * along;
    place.y = u_height;
    float share = 1.0 - smoothstep(u_fade.x, u_fade.y, distance(place.xz, u_centre));
    if (dot(u_depth, vec4(place, 1.0)) <= 0.0 || share <= 0.0) discard;
    o_place = vec4(place, share);
}
