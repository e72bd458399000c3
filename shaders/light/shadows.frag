#version 330
// Depth alone, or with BODIES the body that is seen there too.
#ifdef BODIES
flat in float v_body;
out float o_body;

void main() {
    o_body = v_body;
}
#else
void main() {}
#endif
