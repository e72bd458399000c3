// Where a volume of the nodes is read; where it is an atlas of bodies (core/grid/atlas.py), each body has its own part.
uniform vec2 u_bodies;  // the first body of the matter that is drawn, and the first one after it
uniform mat4 u_world_to_texture;
uniform bool u_separate;
uniform sampler2D t_windows;  // three texels a body, row by row: what it adds to texture coordinates, its first node,
                              // its last

bool is_drawn(float body) { return body >= u_bodies.x && body < u_bodies.y; }

vec3 of_body(int body, int which) {
    int bodies = textureSize(t_windows, 0).x / 3;
    return texelFetch(t_windows, ivec2(3 * (body % bodies) + which, body / bodies), 0).xyz;
}

// Texture coordinates of a place in or on a body; beyond the body's nodes those of their edge.
vec3 volume_coordinates(vec3 position, float body) {
    vec3 coordinates = (u_world_to_texture * vec4(position, 1.0)).xyz;
    if (!u_separate) return coordinates;
    int i = int(body);
    return clamp(coordinates + of_body(i, 0), of_body(i, 1), of_body(i, 2));
}
