#version 330
// Position and normal of the visible surface, world space.
// BODIES: with its body, for which llvmpipe takes a fifth longer; without, all of it is one body. VISIBLE: with the
// share of the environment's light that the surface is not in the way of. LIT: with exitance and the visible shares of
// lamps instead, as they are known at the vertices.
#include "gbuffer.glsl"
#include "visible.glsl"

in vec3 v_position;
in vec3 v_normal;
layout(location = 0) out vec4 o_position;  // a: 1 where the object is
layout(location = 1) out vec4 o_normal;    // a: body

#ifdef BODIES
flat in float v_body;
#else
const float v_body = 0.0;
#endif

#ifdef VISIBLE
in vec3 v_visible;
in vec3 v_behind;
in vec4 v_lobe;
layout(location = 2) out vec4 o_visible;  // a: the same on the other side of a thin slab, see visible.glsl
layout(location = 3) out vec4 o_lobe;     // of the highlight, see highlights_vertices.vert; not where there is none
#endif

#ifdef LIT
in vec3 v_exitance;
in vec3 v_first_lamps;
in vec3 v_last_lamps;
in vec4 v_lobe;
layout(location = 2) out vec4 o_lit;   // rgb: exitance; a: shares of the first three lamps, see visible.glsl
layout(location = 3) out vec4 o_lobe;  // as with VISIBLE
#endif

void main() {
    o_position = vec4(v_position, 1.0);
    o_normal = vec4(unit_normal(v_normal), v_body);
#ifdef VISIBLE
    o_visible = vec4(v_visible, packed_share(v_behind));
    o_lobe = v_lobe;
#endif
#ifdef LIT
    o_position.a += packed_share(v_last_lamps);  // of the other three, and 1: as much as a float holds exactly
    o_lit = vec4(v_exitance, packed_share(v_first_lamps));
    o_lobe = v_lobe;
#endif
}
