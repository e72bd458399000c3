// Luminance of linear sRGB (ITU-R BT.709). Mirrors core/display.py.
float luminance(vec3 rgb) {
    return dot(rgb, LUMINANCE);
}
