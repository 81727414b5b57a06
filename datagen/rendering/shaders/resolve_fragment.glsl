// A pixel of the picture: what is opaque, and over it what is transparent. Where surfaces meet (EDGES), each of the
// samples around the centre has the colour of the pixel beside it that shows the same surface. The test of depth leaves
// out all other pixels: what draws them first leaves a depth of 1 where there is an edge, of 0 elsewhere.

uniform sampler2D colours;  // of each pixel's centre
uniform sampler2D edges;    // z: depth that parts nearer from farther, mm; w: 1 where a pixel has more than one surface
uniform sampler2D over_near, over_far, blended_label;

layout(location = 0) out vec4 radiance;
layout(location = 1) out vec4 label;

vec4 nearer, farther;
float share;  // of the pixel that the nearer surface has

#ifdef EDGES
void add_sample(ivec2 pixel, ivec2 last, ivec2 offset, float middle) {
    float weight = (offset.x == 0 ? 0.5 : 0.25) * (offset.y == 0 ? 0.5 : 0.25);
    vec2 here = seen_at(2 * pixel + 1 + offset);
    vec4 found = vec4(0.0);
    float best = 1e9;
    for (int k = 0; k < 4; ++k) {
        ivec2 other = clamp(pixel + offset * ivec2(k & 1, k >> 1), ivec2(0), last);
        vec2 there = seen_at(2 * other + 1);
        float unlike = abs(there.y - here.y) + (there.x == here.x ? 0.0 : 1e5) + (there.x == 0.0 ? 1e8 : 0.0)
                     + float(k) * 1e-3;
        if (unlike < best) found = texelFetch(colours, other, 0);
        best = min(best, unlike);
    }
    found *= here.x == 0.0 ? 0.0 : weight;
    bool is_near = here.y <= middle;
    nearer += is_near ? found : vec4(0.0);
    farther += is_near ? vec4(0.0) : found;
    share += is_near ? weight : 0.0;
}
#endif

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    farther = vec4(0.0);
#ifdef EDGES
    float middle = texelFetch(edges, pixel, 0).z;
    ivec2 last = textureSize(colours, 0) - 1;
    nearer = vec4(0.0);
    share = 0.0;
    for (int i = 0; i < 9; ++i) add_sample(pixel, last, ivec2(i % 3, i / 3) - 1, middle);
#else
    gl_FragDepth = texelFetch(edges, pixel, 0).w;
    nearer = texelFetch(colours, pixel, 0);
    share = 1.0;
#endif
    float seen_label = abs(seen_at(2 * pixel + 1).x) / 255.0;
    radiance = nearer + farther;
#ifdef BLENDED
    vec4 before = texelFetch(over_near, pixel, 0), behind = texelFetch(over_far, pixel, 0);
    radiance = before * share + nearer * (1.0 - before.a) + behind * (1.0 - share) + farther * (1.0 - behind.a);
    float blended = texelFetch(blended_label, pixel, 0).x;
    seen_label = blended > 0.0 ? blended : seen_label;
#endif
    label = vec4(seen_label);
}
