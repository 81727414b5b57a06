// What one pixel sees of the mesh.

uniform usampler2D seen;    // number of the nearest triangle; n_triangles and more: none
uniform uint n_triangles;
uniform float inverse_distance;  // 1 / depth of order 0 in 1/mm; 0 for an affine camera
uniform float outside;           // sign of the area in the image of triangles that show their outside

struct Sight {
    bool hit;       // anything at all
    bool is_face;   // the outside of a face triangle
    uint region;    // from 0
    uint triangle;
    uvec3 corner;   // vertices
    vec3 weight;    // on the surface, perspective-correct
    float depth;    // mm, relative to order 0
};

float turn(vec2 a, vec2 b) {
    return a.x * b.y - a.y * b.x;
}

Sight look(vec2 centre) {
    Sight sight;
    uint triangle = texelFetch(seen, ivec2(centre), 0).x;
    sight.hit = triangle < n_triangles;
    sight.triangle = min(triangle, n_triangles - 1u);
    uvec4 pair = texelFetch(pairs, texel(sight.triangle >> 1), 0);
    uvec4 flags = pair >> VERTEX_BITS;
    bool is_first = (sight.triangle & 1u) == 0u;
    pair &= (1u << VERTEX_BITS) - 1u;
    sight.corner = is_first ? pair.xyz : pair.xzw;
    sight.region = is_first ? flags.x : flags.y;
    vec3 a = on_screen(sight.corner.x), b = on_screen(sight.corner.y), c = on_screen(sight.corner.z);
    vec3 order = vec3(a.z, b.z, c.z);
    vec2 to_a = a.xy - centre, to_b = b.xy - centre, to_c = c.xy - centre;
    vec3 sides = vec3(turn(to_b, to_c), turn(to_c, to_a), turn(to_a, to_b));
    float area = sides.x + sides.y + sides.z;
    vec3 inside = max(sides * sign(area), 0.0);
    inside = area != 0.0 ? inside / (inside.x + inside.y + inside.z) : vec3(1.0 / 3.0);
    vec3 on_surface = inside * (1.0 - order * inverse_distance);
    sight.weight = on_surface / (on_surface.x + on_surface.y + on_surface.z);
    float order_here = dot(inside, order);
    sight.depth = order_here / (1.0 - order_here * inverse_distance);
    sight.is_face = sight.hit && area * outside > 0.0 && ((flags.z >> (sight.triangle & 1u)) & 1u) == 1u;
    return sight;
}
