// Which triangle is nearest at each pixel centre, without an order among threads: a key holds a coarse depth above and
// a triangle below, and the smallest key stays. Where a triangle meets one of its own coarse depth there, a second key
// keeps the highest triangle of them: whoever comes second notices, in whatever order they come. Where the second key
// has the depth of the first, the host compares both triangles in float64.

layout(local_size_x = 512) in;

layout(std430, binding = 0) buffer Lowest { uint lowest[]; };
layout(std430, binding = 1) buffer Highest { uint highest[]; };

uniform ivec2 size;
uniform uint n_pairs;
uniform int triangle_bits;
uniform vec2 coarse_depth;  // coarse depth = (order - x) * y

const uint NONE = 0xffffffffu;

// The same for an edge in both directions but for the sign, bit for bit: no contraction, no centre between triangles.
float turn(vec2 a, vec2 b) {
    precise float ab = a.x * b.y;
    precise float ba = a.y * b.x;
    precise float result = ab - ba;
    return result;
}

bool covers(vec3 sides, float area) {
    return area != 0.0 && (min(min(sides.x, sides.y), sides.z) >= 0.0 || max(max(sides.x, sides.y), sides.z) <= 0.0);
}

uint depth_key(vec3 sides, float area, vec3 order) {
    float depth = (dot(sides, order) / area - coarse_depth.x) * coarse_depth.y;
    return uint(clamp(depth, 0.0, float((NONE >> triangle_bits) - 1u))) << triangle_bits;
}

void draw_pair(uint pair) {
    uvec4 corner = texelFetch(pairs, texel(pair), 0) & ((1u << VERTEX_BITS) - 1u);
    vec3 a = on_screen(corner.x), b = on_screen(corner.y), c = on_screen(corner.z), d = on_screen(corner.w);
    vec2 low = min(min(a.xy, b.xy), min(c.xy, d.xy)), high = max(max(a.xy, b.xy), max(c.xy, d.xy));
    ivec2 first = ivec2(ceil(clamp(low - 0.5, vec2(0.0), vec2(size))));
    ivec2 last = ivec2(floor(clamp(high - 0.5, vec2(-1.0), vec2(size) - 1.0)));
    if (first.x > last.x || first.y > last.y) return;  // no pixel centre in the bounding box
    uint all_triangles = (1u << triangle_bits) - 1u;
    ivec2 pixel = first;
    while (true) {
        vec2 centre = vec2(pixel) + 0.5;
        vec2 to_a = a.xy - centre, to_b = b.xy - centre, to_c = c.xy - centre, to_d = d.xy - centre;
        float diagonal = turn(to_c, to_a);
        vec3 abc = vec3(turn(to_b, to_c), diagonal, turn(to_a, to_b));
        vec3 acd = vec3(turn(to_c, to_d), turn(to_d, to_a), -diagonal);
        float area_abc = abc.x + abc.y + abc.z, area_acd = acd.x + acd.y + acd.z;
        bool in_abc = covers(abc, area_abc), in_acd = covers(acd, area_acd);
        uint depth_abc = depth_key(abc, area_abc, vec3(a.z, b.z, c.z));
        uint depth_acd = depth_key(acd, area_acd, vec3(a.z, c.z, d.z));
        uint key_abc = 2u * pair, key_acd = 2u * pair + 1u;
        uint low_key = min(in_abc ? depth_abc | key_abc : NONE, in_acd ? depth_acd | key_acd : NONE);
        if (low_key != NONE) {
            uint index = uint(pixel.y * size.x + pixel.x);
            uint before = atomicMin(lowest[index], low_key);
            // The higher triangle of a tie: with the one before, or within the pair. An atomic operation costs more
            // than all else here, and ties are few.
            uint depth = low_key & ~all_triangles;
            bool ties = (before & ~all_triangles) == depth && before != NONE;
            bool ties_within = in_abc && in_acd && depth_abc == depth_acd;
            uint other = max(ties ? before & all_triangles : 0u, ties_within ? key_acd : 0u);
            if (ties || ties_within)
                atomicMin(highest[index], depth | (all_triangles - max(other, low_key & all_triangles)));
        }
        if (++pixel.x > last.x) {
            pixel.x = first.x;
            if (++pixel.y > last.y) break;
        }
    }
}

void main() {
    for (uint pair = gl_GlobalInvocationID.x; pair < n_pairs; pair += gl_NumWorkGroups.x * gl_WorkGroupSize.x)
        draw_pair(pair);
}
