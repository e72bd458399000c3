#version 330
// Clay under a wide light from above the eye: nothing but the shape is known yet.
in vec3 v_normal;
out vec4 o_colour;

const vec3 CLAY = vec3(0.62, 0.60, 0.57);
const vec3 TO_LIGHT = vec3(0.0, 0.6, 0.8);

void main() {
    vec3 normal = normalize(gl_FrontFacing ? v_normal : -v_normal);
    o_colour = vec4(CLAY * (0.35 + 0.65 * max(0.0, dot(normal, TO_LIGHT))), 1.0);
}
