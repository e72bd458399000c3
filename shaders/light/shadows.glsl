// Williams 1978, Casting Curved Shadows on Curved Surfaces: visibility of a light through its shadow map; with
// percentage-closer filtering, Reeves et al. 1987, Rendering Antialiased Shadows with Depth Maps.
//
// A light has 1 view, or CUBE_VIEWS (the faces of a cube) where it stands inside the object's bounding sphere; they are
// tiles of one depth texture, 1 x 1 or 3 x 2.

uniform sampler2DShadow t_shadow;
uniform int u_shadow_views;             // 0 (no shadow), 1 or CUBE_VIEWS
uniform mat4 u_shadow_world_to_clip[CUBE_VIEWS];
uniform float u_shadow_texel;           // size of a texel: mm (directional), mm per mm of distance (point)

const float NORMAL_OFFSET = 1.5;  // texels along the normal at grazing light: a texel's own slope
const float LIGHT_OFFSET = 0.75;  // texels towards the light: rasterised depth is off by half a texel

// Columns and rows of tiles in the depth texture.
vec2 shadow_tiles() {
    return u_shadow_views == CUBE_VIEWS ? vec2(3.0, 2.0) : vec2(1.0);
}

mat4 shadow_to_clip(int view) { return u_shadow_world_to_clip[view]; }

// position: world, mm; normal, to_light: unit; distance: to the light, 1 for a directional one. Returns [0, 1].
float shadow_visibility(vec3 position, vec3 normal, vec3 to_light, float distance) {
    float texel = u_shadow_texel * distance;
    float slope = sqrt(max(0.0, 1.0 - dot(normal, to_light) * dot(normal, to_light)));
    vec3 start = position + texel * (NORMAL_OFFSET * slope * normal + LIGHT_OFFSET * to_light);
    vec2 tiles = shadow_tiles();
    vec2 size = vec2(textureSize(t_shadow, 0)) / tiles;
    for (int view = 0; view < u_shadow_views; ++view) {
        vec4 clip = u_shadow_world_to_clip[view] * vec4(start, 1.0);
        if (clip.w <= 0.0 || any(greaterThan(abs(clip.xy), vec2(clip.w)))) continue;
        vec3 window = 0.5 * clip.xyz / clip.w + 0.5;
        vec2 tile = vec2(view % 3, view / 3);
        float sum = 0.0;
        for (int tap = 0; tap < 4; ++tap) {
            vec2 offset = vec2(tap & 1, tap >> 1) - 0.5;  // texels; the filter of each tap spans 2 x 2 more
            vec2 uv = clamp(window.xy + offset / size, 0.5 / size, 1.0 - 0.5 / size);
            sum += textureLod(t_shadow, vec3((uv + tile) / tiles, window.z), 0.0);
        }
        return 0.25 * sum;
    }
    return 1.0;
}
