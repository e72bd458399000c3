// Unit normal of an interpolated one. Opposite normals can cancel halfway along an edge, and a zero vector would become
// NaN.
vec3 unit_normal(vec3 normal) {
    float size = length(normal);
    return size > 1e-6 ? normal / size : vec3(0.0, 0.0, 1.0);
}
