#version 330
// Depth, and the body that is seen there.
flat in float v_body;
out float o_body;

void main() {
    o_body = v_body;
}
