// Table of a display transform, viewer/display/base.py, read by tetrahedra: Kasson, Nin, Plouffe and Hafner 1995,
// Performing Color Space Conversions with Three-Dimensional Linear Interpolation.

// exposed: linear RGB, >= 0; returns colours encoded as sRGB
vec3 display_table(sampler3D table, vec3 exposed) {
    int last = textureSize(table, 0).x - 1;
    vec3 place = log(1.0 + min(exposed, DISPLAY_BRIGHTEST) / DISPLAY_TOE) / log(1.0 + DISPLAY_BRIGHTEST / DISPLAY_TOE);
    place = clamp(place, 0.0, 1.0) * float(last);
    ivec3 node = min(ivec3(place), last - 1);
    vec3 along = place - vec3(node);
    // From the cell's dark corner to its bright one, first along the channel that lies farthest on.
    ivec3 first, second;
    if (along.r >= along.g) {
        first = along.r >= along.b ? ivec3(1, 0, 0) : ivec3(0, 0, 1);
        second = along.r < along.b ? ivec3(1, 0, 1) : along.g >= along.b ? ivec3(1, 1, 0) : ivec3(1, 0, 1);
    } else {
        first = along.g >= along.b ? ivec3(0, 1, 0) : ivec3(0, 0, 1);
        second = along.g < along.b ? ivec3(0, 1, 1) : along.r >= along.b ? ivec3(1, 1, 0) : ivec3(0, 1, 1);
    }
    float far = max(along.r, max(along.g, along.b)), near = min(along.r, min(along.g, along.b));
    float middle = along.r + along.g + along.b - far - near;
    return (1.0 - far) * texelFetch(table, node, 0).rgb + (far - middle) * texelFetch(table, node + first, 0).rgb
        + (middle - near) * texelFetch(table, node + second, 0).rgb + near * texelFetch(table, node + 1, 0).rgb;
}
