// Lat-long coordinates of a direction (unit, probe space): u right, v down from +y, both in [0, 1].
// d = (sin theta sin phi, cos theta, -sin theta cos phi), theta = pi v, phi = 2 pi (u - 1/2): the centre is -z.
// Mirrors core/environment.py.
vec2 latlong_uv(vec3 d) {
    const float PI = 3.14159265358979;
    // At the poles phi is free: any value does, NaN does not.
    float phi = abs(d.x) + abs(d.z) > 0.0 ? atan(d.x, -d.z) : 0.0;
    return vec2(phi / (2.0 * PI) + 0.5, acos(clamp(d.y, -1.0, 1.0)) / PI);
}
