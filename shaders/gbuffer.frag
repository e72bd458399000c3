#version 330
// Position, normal and body of the visible surface, world space.
in vec3 v_position;
in vec3 v_normal;
flat in float v_body;
layout(location = 0) out vec4 o_position;  // a: 1 where the object is
layout(location = 1) out vec4 o_normal;    // a: body

void main() {
    o_position = vec4(v_position, 1.0);
    // Opposite normals can cancel halfway along an edge; a zero vector would become NaN.
    float size = length(v_normal);
    o_normal = vec4(size > 1e-6 ? v_normal / size : vec3(0.0, 0.0, 1.0), v_body);
}
