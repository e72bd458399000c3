// Fernando 2005, Percentage-Closer Soft Shadows: visibility of a sub-light through its shadow map, whose edges are as
// wide as the shadow of the piece of the light that it stands for. What the steps from sub-light to sub-light would show
// of their number is thus smooth.
//
// The views of all sub-lights, 1 or CUBE_VIEWS (the faces of a cube) each, are tiles of one depth texture.

uniform sampler2D t_shadow_depth;
uniform sampler2D t_sub_lights;  // a row a sub-light: its vector and the first tap's angle; 4 columns of a view's
                                 // matrix from the world to clip space, 4 of its inverse
uniform int u_shadow_views;      // 0 (no shadow), 1 or CUBE_VIEWS
uniform vec2 u_shadow_tiles;     // columns, rows
uniform float u_shadow_texel;    // size of a texel: mm (directional), mm per mm of depth (point)
uniform vec2 u_shadow_range;     // depths between which the maps lie, mm; of a directional light half their distance
uniform float u_piece;           // size of a sub-light: radius of its filter, as seen from there, radians or mm
uniform float u_widest;          // mm along the surface that the filter and offsets reach: walls are thicker
uniform int u_taps;

const float NORMAL_OFFSET = 1.25;  // texels along the normal at grazing light: a texel's own slope
const float LIGHT_OFFSET = 0.75;   // texels towards the light: rasterised depth is off by half a texel
const float SHARPEST = 1.1;        // texels: radius of the filter where the light has no size
const int SEARCH = 5;              // taps that look for what is in the way
const mat2 TURN = mat2(-0.737368878, 0.675490294, -0.675490294, -0.737368878);  // by the golden angle

vec2 shadow_tiles() { return u_shadow_tiles; }

vec4 sub_light(int i) { return texelFetch(t_sub_lights, ivec2(0, i), 0); }

// A view's matrix to clip space (first 0) or from there (first 4).
mat4 sub_light_matrix(int view, int first) {
    int column = 1 + 8 * (view % u_shadow_views) + first, row = view / u_shadow_views;
    return mat4(texelFetch(t_sub_lights, ivec2(column, row), 0),
                texelFetch(t_sub_lights, ivec2(column + 1, row), 0),
                texelFetch(t_sub_lights, ivec2(column + 2, row), 0),
                texelFetch(t_sub_lights, ivec2(column + 3, row), 0));
}

mat4 shadow_to_clip(int view) { return sub_light_matrix(view, 0); }

// How much nearer to the light than a place (clip space) the map has something, mm, <= 0 where nothing is; how near it
// is to the light.
vec2 in_the_way(int view, vec4 clip) {
    vec2 size = vec2(textureSize(t_shadow_depth, 0)) / u_shadow_tiles;
    vec2 place = clamp(0.5 * clip.xy / clip.w + 0.5, 0.5 / size, 1.0 - 0.5 / size);
    int columns = int(u_shadow_tiles.x);
    float depth = textureLod(t_shadow_depth, (place + vec2(view % columns, view / columns)) / u_shadow_tiles, 0.0).r;
    if (depth == 1.0) return vec2(-1.0, 1.0);  // nothing, for places farther than the map too
    float ndc = 2.0 * depth - 1.0;
    if (u_light_kind != LIGHT_POINT) return vec2((clip.z - ndc) * u_shadow_range.y, 1.0);
    float near = u_shadow_range.x, far = u_shadow_range.y;
    float there = 2.0 * far * near / (far + near - ndc * (far - near));
    return vec2(clip.w - there, there);
}

// position: world, mm; normal, to_light: unit. Returns [0, 1].
float soft_visibility(int i, vec3 position, vec3 normal, vec3 to_light) {
    float cosine = dot(normal, to_light);
    float slope = sqrt(max(0.0, 1.0 - cosine * cosine));
    vec3 off = NORMAL_OFFSET * slope * normal + LIGHT_OFFSET * to_light;
    int view = i * u_shadow_views, last = view + u_shadow_views;
    mat4 to_clip;
    vec4 centre;
    float texel;
    for (; view < last; ++view) {
        to_clip = shadow_to_clip(view);
        centre = to_clip * vec4(position, 1.0);
        texel = u_shadow_texel * centre.w;  // w: depth, 1 of a directional light
        centre += to_clip * vec4(texel * off, 0.0);
        if (centre.w > 0.0 && all(lessThanEqual(abs(centre.xy), vec2(centre.w)))) break;
    }
    if (view == last) return 1.0;
    // Steps of 1 mm along the surface: a filter beside it would find the surface itself.
    vec3 aside = normalize(abs(normal.y) < 0.9 ? vec3(normal.z, 0.0, -normal.x) : vec3(0.0, -normal.z, normal.y));
    vec4 right = to_clip * vec4(aside, 0.0);
    vec4 up = to_clip * vec4(cross(normal, aside), 0.0);
    float angle = sub_light(i).w;
    vec2 turned = vec2(cos(angle), sin(angle));
    float radius = SHARPEST * texel;
    if (u_piece > 0.0) {
        float reach = u_light_kind == LIGHT_POINT ? u_piece * (centre.w / u_shadow_range.x - 1.0)
                                            : u_piece * (centre.z + 1.0) * u_shadow_range.y;
        reach = max(min(reach, u_widest - LIGHT_OFFSET * texel), radius);
        float gap = 0.0, found = 0.0;
        for (int tap = 0; tap < SEARCH; ++tap) {
            vec2 place = reach * sqrt(float(tap) / float(SEARCH - 1)) * turned;
            vec2 way = in_the_way(view, centre + place.x * right + place.y * up);
            if (way.x > 0.0) {
                gap += way.x / way.y;
                found += 1.0;
            }
            turned = TURN * turned;
        }
        if (found == 0.0) return 1.0;
        if (found == float(SEARCH)) return 0.0;
        radius = clamp(u_piece * gap / found, radius, reach);
    }
    float lit = 0.0;
    for (int tap = 0; tap < u_taps; ++tap) {
        vec2 place = radius * sqrt((float(tap) + 0.5) / float(u_taps)) * turned;
        if (in_the_way(view, centre + place.x * right + place.y * up).x <= 0.0) lit += 1.0;
        turned = TURN * turned;
    }
    return lit / float(u_taps);
}
