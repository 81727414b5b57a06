// A pixel from the samples around its centre: each has the colour of the pixel beside it that shows the same surface.
// Then what is transparent comes over the nearer and the farther surface of it.

uniform sampler2D colours;  // of each pixel's centre
uniform sampler2D edges;    // z: depth that parts nearer from farther, mm; w: 1 where a pixel has more than one surface
uniform sampler2D over_near, over_far, blended_label;
uniform bool has_blended;

layout(location = 0) out vec4 radiance;
layout(location = 1) out vec4 label;

vec4 nearer, farther;
float share;

// The colour of a sample: from the pixel whose centre is most like it.
void add_sample(ivec2 pixel, ivec2 last, ivec2 offset, float weight, float middle) {
    vec3 sample_seen = seen_at(2 * pixel + 1 + offset);
    vec4 found = vec4(0.0);
    float best = 1e9;
    for (int k = 0; k < 4; ++k) {
        ivec2 other = clamp(pixel + offset * ivec2(k & 1, k >> 1), ivec2(0), last);
        vec3 there = seen_at(2 * other + 1);
        float unlike = abs(there.y - sample_seen.y) + (there.x == sample_seen.x ? 0.0 : 1e5)
                     + (there.x == 0.0 ? 1e8 : 0.0) + float(k) * 1e-3;
        if (unlike < best) found = texelFetch(colours, other, 0);
        best = min(best, unlike);
    }
    found *= sample_seen.x == 0.0 ? 0.0 : weight;
    bool is_near = sample_seen.y <= middle;
    nearer += is_near ? found : vec4(0.0);
    farther += is_near ? vec4(0.0) : found;
    share += is_near ? weight : 0.0;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), last = textureSize(colours, 0) - 1;
    vec4 edge = texelFetch(edges, pixel, 0);
    nearer = texelFetch(colours, pixel, 0);
    farther = vec4(0.0);
    share = 1.0;
    // A loop instead of a branch: software drivers skip it where no pixel of eight has an edge.
    int n_samples = edge.w > 0.5 ? 9 : 0;
    nearer = n_samples > 0 ? vec4(0.0) : nearer;
    share = n_samples > 0 ? 0.0 : 1.0;
    for (int i = 0; i < n_samples; ++i) {
        ivec2 offset = ivec2(i % 3, i / 3) - 1;
        float weight = (offset.x == 0 ? 0.5 : 0.25) * (offset.y == 0 ? 0.5 : 0.25);
        add_sample(pixel, last, offset, weight, edge.z);
    }
    float seen_label = abs(seen_at(2 * pixel + 1).x) / 255.0;
    radiance = nearer + farther;
    if (has_blended) {
        vec4 before = texelFetch(over_near, pixel, 0), behind = texelFetch(over_far, pixel, 0);
        radiance = before * share + nearer * (1.0 - before.a) + behind * (1.0 - share) + farther * (1.0 - behind.a);
        float blended = texelFetch(blended_label, pixel, 0).x;
        seen_label = blended > 0.0 ? blended : seen_label;
    }
    label = vec4(seen_label);
}
