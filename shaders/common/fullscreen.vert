#version 330
// One triangle that covers the screen, at the far plane; draw 3 vertices, no buffers.

void main() {
    gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 1.0, 1.0);
}
