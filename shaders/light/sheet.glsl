// Dachsbacher and Stamminger 2003, Translucent Shadow Maps, used for a remainder: thin slabs lit from behind, the
// light of the other side that the layers are too coarse to carry across. Mirrored by core/reference/sheet.py.
//
// A surface that faces away from a light sees it through the object; the shadow map knows where the light entered. If
// the way between is short, the two sides are a thin slab of that thickness, and the local term of
// core/transport/pixels.py applies to the irradiance over there. Needs irradiance.glsl.

#ifdef SOFT
mat4 shadow_to_world(int view) { return sub_light_matrix(view, 4); }
#else
uniform sampler2D t_shadow_depth;         // the texture of t_shadow, its depths
uniform mat4 u_shadow_clip_to_world[CUBE_VIEWS];

mat4 shadow_to_world(int view) { return u_shadow_clip_to_world[view]; }
#endif

uniform bool u_separate_shadow;           // whether bodies scatter light each alone
uniform sampler2D t_shadow_body;          // then: the body that t_shadow_depth is of
uniform sampler2D t_sheet;                // factor over thickness, RGB; one row
uniform float u_sheet_reach;              // thickness of its last texel, mm; 0: no local term

// Texture coordinates of a place (NDC) of one of the shadow map's views.
vec2 shadow_uv(int view, vec2 place) {
    int columns = int(shadow_tiles().x);
    return (0.5 * place + 0.5 + vec2(view % columns, view / columns)) / shadow_tiles();
}

// Point where light enters, world space, that the shadow map knows at a place of one of its views (NDC).
vec3 light_entry(int view, vec2 place) {
    float depth = textureLod(t_shadow_depth, shadow_uv(view, place), 0.0).r;
    vec4 entry = shadow_to_world(view) * vec4(place, 2.0 * depth - 1.0, 1.0);
    return entry.xyz / entry.w;
}

// Share of the surroundings of an entry, a window's width away on four sides, that goes on as its plane does: 1 on a
// sheet, about 1/2 at its rim, 0 in a sliver of light between folds.
float flatness(int view, vec2 place, vec3 entry, vec3 normal, float width, vec2 ndc_a_mm) {
    float sum = 0.0;
    for (int i = 0; i < 4; ++i) {
        vec2 side = width * ndc_a_mm * vec2(i < 2 ? 2 * i - 1 : 0, i < 2 ? 0 : 2 * i - 5);
        float off = abs(dot(light_entry(view, place + side) - entry, normal));
        sum += 1.0 - smoothstep(SHEET_FLAT.x, SHEET_FLAT.y, off / width);
    }
    return 0.25 * sum;
}

// What enters the other side of a thin slab.
struct Behind {
    vec3 irradiance;  // E there, times how far the two sides are a thin slab
    float thickness;  // mm
    float cosine;     // of the light to the normal there
};
const Behind NOTHING_BEHIND = Behind(vec3(0.0), 0.0, 1.0);

// i: sub-light, to_light: towards it. normal: outward at `position`, facing away from it. body: that `position` is of.
Behind light_behind(int i, vec3 position, vec3 normal, vec3 to_light, float body) {
    vec2 texel = 2.0 * shadow_tiles() / vec2(textureSize(t_shadow_depth, 0));
    for (int view = i * u_shadow_views; view < (i + 1) * u_shadow_views; ++view) {
        vec4 clip = shadow_to_clip(view) * vec4(position, 1.0);
        if (clip.w <= 0.0 || any(greaterThan(abs(clip.xy), vec2(clip.w)))) continue;
        vec2 place = clip.xy / clip.w;
        // What another body's surface catches does not go on in this one, which lies in its shadow.
        if (u_separate_shadow && textureLod(t_shadow_body, shadow_uv(view, place), 0.0).r != body)
            return NOTHING_BEHIND;
        vec3 entry = light_entry(view, place);
        float way = dot(entry - position, to_light);
        if (way <= 0.0 || way >= u_sheet_reach) return NOTHING_BEHIND;
        float thickness = way * -dot(normal, to_light);
        vec3 other = cross(light_entry(view, place + vec2(2.0 * texel.x, 0.0)) - entry,
                           light_entry(view, place + vec2(0.0, 2.0 * texel.y)) - entry);
        if (dot(other, other) == 0.0) return NOTHING_BEHIND;  // no plane, and a zero vector would become NaN
        other = normalize(other) * sign(dot(other, to_light));
        // Only parallel sides are a thin slab; at the edge of the light on a ball they are one and the same surface.
        float parallel = smoothstep(SHEET_PARALLEL.x, SHEET_PARALLEL.y, -dot(normal, other));
        Arrival arrival = unshadowed(i, entry);
        // Along a grazing ray the sides are far apart, however thin it looks from here.
        float near = 1.0 - smoothstep(SHEET_NEAR.x, SHEET_NEAR.y, way / u_sheet_reach);
        float sheet = parallel * near
            * flatness(view, place, entry, other, SHEET_PROBE * u_sheet_reach,
                       texel / (u_shadow_texel * arrival.distance));
        // The lesser cosine: at the edge of the light both sides fade, as they do where they are parallel.
        float cosine = clamp(dot(other, to_light), 0.0, -dot(normal, to_light));
        vec3 irradiance = fresnel_transmittance(u_eta, cosine) * cosine * arrival.irradiance;
        return Behind(sheet * irradiance, thickness, cosine);
    }
    return NOTHING_BEHIND;
}

// Local exitance that light behind a thin slab adds on this side.
vec3 light_through_sheet(Behind behind) {
    float nodes = float(textureSize(t_sheet, 0).x);
    float s = (behind.thickness / u_sheet_reach * (nodes - 1.0) + 0.5) / nodes;
    return textureLod(t_sheet, vec2(s, 0.5), 0.0).rgb * behind.irradiance;
}
