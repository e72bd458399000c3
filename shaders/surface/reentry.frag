#version 330
// See reentry.vert.
in vec3 v_irradiance;
in vec3 v_behind;
layout(location = 0) out vec4 o_irradiance;
layout(location = 1) out vec4 o_behind;

void main() {
    // Interpolation rounds, and so gives a little less than 0 between vertices of 0.
    o_irradiance = vec4(max(v_irradiance, 0.0), 1.0);
    o_behind = vec4(max(v_behind, 0.0), 1.0);
}
