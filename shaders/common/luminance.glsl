// Luminance of linear sRGB (ITU-R BT.709). Mirrors core/tonemap.py.
float luminance(vec3 rgb) {
    return dot(rgb, vec3(0.2126, 0.7152, 0.0722));
}
