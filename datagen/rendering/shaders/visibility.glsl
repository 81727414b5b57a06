// What the samples around a pixel's centre see: at -1/2, 0 and 1/2 px in each direction, the outer ones shared.

const float NOTHING_MM = 1e7;

uniform sampler2D seen;        // x: triangle of the head from 1, an object's label below 0, nothing 0; y: depth
uniform vec4 depth_from_buffer;  // mm: (x z + y) / (z z + w)
uniform float edge_mm;         // surfaces of one kind are two where their depths differ by more

vec3 seen_at(ivec2 fine) {  // what (1 the head), depth in mm, depth in the buffer
    vec2 found = texelFetch(seen, fine, 0).xy;
    float depth = (depth_from_buffer.x * found.y + depth_from_buffer.y)
                / (depth_from_buffer.z * found.y + depth_from_buffer.w);
    return vec3(min(found.x, 1.0), found.x == 0.0 ? NOTHING_MM : depth, found.y);
}
