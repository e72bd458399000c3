// Lat-long coordinates of a direction (unit, probe space): u right, v down from +y, both in [0, 1].
// d = (sin theta sin phi, cos theta, -sin theta cos phi), theta = pi v, phi = 2 pi (u - 1/2): the centre is -z.
// Mirrors core/light/maps.py.
vec2 latlong_uv(vec3 d) {
    // At the poles phi is free: any value does, NaN does not.
    float phi = abs(d.x) + abs(d.z) > 0.0 ? atan(d.x, -d.z) : 0.0;
    return vec2(phi / (2.0 * PI) + 0.5, acos(clamp(d.y, -1.0, 1.0)) / PI);
}

// Value of a table over directions whose rows run from pole to pole, so that a floor's normal needs no extrapolation.
vec3 latlong_table(sampler2D table, vec3 d) {
    vec2 uv = latlong_uv(d);
    float rows = float(textureSize(table, 0).y);
    uv.y = (uv.y * (rows - 1.0) + 0.5) / rows;
    return textureLod(table, uv, 0.0).rgb;
}
