// In place of shadow_entry.glsl with the maps of shadows_soft.glsl.
mat4 shadow_to_world(int view) { return sub_light_matrix(view, 4); }
