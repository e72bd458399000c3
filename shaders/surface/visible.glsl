// Three shares in [0, 1] in one float: 8 bits each, whole numbers that a float holds exactly.
float packed_share(vec3 share) {
    vec3 steps = floor(255.0 * clamp(share, 0.0, 1.0) + 0.5);
    return steps.r + 256.0 * steps.g + 65536.0 * steps.b;
}

vec3 unpacked_share(float value) {
    float upper = floor(value / 256.0);
    return vec3(value - 256.0 * upper, mod(upper, 256.0), floor(upper / 256.0)) / 255.0;
}
