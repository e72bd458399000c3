// Back from a shadow map of shadows.glsl to the world, for sheet.glsl.
uniform sampler2D t_shadow_depth;  // the texture of t_shadow, its depths
uniform mat4 u_shadow_clip_to_world[6];

mat4 shadow_to_world(int view) { return u_shadow_clip_to_world[view]; }
