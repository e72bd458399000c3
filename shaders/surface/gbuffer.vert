#version 330
// BODIES, VISIBLE and LIT: see gbuffer.frag.
uniform mat4 u_world_to_clip;
in vec3 a_position;
in vec3 a_normal;
out vec3 v_position;
out vec3 v_normal;

#ifdef BODIES
in float a_body;  // the same at all corners of a face
flat out float v_body;
#endif

#ifdef VISIBLE
in vec3 a_visible;
in vec3 a_behind;
in vec4 a_lobe;
out vec3 v_visible;
out vec3 v_behind;
out vec4 v_lobe;
#endif

#ifdef LIT
in vec3 a_exitance;
in vec3 a_first_lamps;
in vec3 a_last_lamps;
in vec4 a_lobe;
out vec3 v_exitance;
out vec3 v_first_lamps;
out vec3 v_last_lamps;
out vec4 v_lobe;
#endif

void main() {
    v_position = a_position;
    v_normal = a_normal;
#ifdef BODIES
    v_body = a_body;
#endif
#ifdef VISIBLE
    v_visible = a_visible;
    v_behind = a_behind;
    v_lobe = a_lobe;
#endif
#ifdef LIT
    v_exitance = a_exitance;
    v_first_lamps = a_first_lamps;
    v_last_lamps = a_last_lamps;
    v_lobe = a_lobe;
#endif
    gl_Position = u_world_to_clip * vec4(a_position, 1.0);
}
