#version 330
// See reentry.vert.
in vec3 v_irradiance;
in vec3 v_behind;
layout(location = 0) out vec4 o_irradiance;
layout(location = 1) out vec4 o_behind;

void main() {
    o_irradiance = vec4(v_irradiance, 1.0);
    o_behind = vec4(v_behind, 1.0);
}
