#version 330
// What was rendered of a photograph's object, as display-referred radiance, weighted by how far it is to be trusted:
// the first level of a pyramid that photo.frag fills gaps from. Mirrors viewer/photograph/composite.py.

uniform sampler2D t_radiance;  // rgb weighted by coverage, a coverage
uniform sampler2D t_trust;     // r, row 0 at the top; of any size
uniform float u_exposure;

out vec4 o_colour;  // rgb weighted by a, a weight

const float MOST = 6e4;  // the target's half floats end at 65504

void main() {
    ivec2 place = ivec2(gl_FragCoord.xy);
    vec4 radiance = texelFetch(t_radiance, place, 0);
    float coverage = min(radiance.a, 1.0);
    vec2 at = gl_FragCoord.xy / vec2(textureSize(t_radiance, 0));
    float trust = coverage * textureLod(t_trust, vec2(at.x, 1.0 - at.y), 0.0).r;
    o_colour = vec4(trust * min(u_exposure * radiance.rgb / max(radiance.a, 1e-6), MOST), trust);
}
