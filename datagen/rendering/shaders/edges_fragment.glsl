// Where two surfaces share a pixel: the depth of the nearer, and (as depth in the buffer) of the farther.

uniform vec4 depth_from_buffer;  // mm: (x d + y) / (z d + w)
uniform float edge_mm;           // surfaces of one kind are two where their depths differ by more

layout(location = 0) out vec4 edges;

float in_buffer(float depth) {
    float d = (depth_from_buffer.w * depth - depth_from_buffer.y) / (depth_from_buffer.x - depth_from_buffer.z * depth);
    return depth >= NOTHING_MM ? 1.0 : d;
}

void main() {
    ivec2 first = 2 * ivec2(gl_FragCoord.xy);
    vec2 centre = seen_at(first + 1);
    float nearest = centre.y, farthest = centre.y;
    float differs = 0.0;
    for (int i = 0; i < 9; ++i) {
        vec2 other = seen_at(first + ivec2(i % 3, i / 3));
        nearest = min(nearest, other.y);
        farthest = max(farthest, other.y);
        differs = max(differs, abs(other.x - centre.x));
    }
    bool parted = farthest - nearest > edge_mm;
    float middle = 0.5 * (min(farthest, nearest + 1000.0) + nearest);
    float nearer = parted && centre.y > middle ? nearest : centre.y;
    gl_FragDepth = in_buffer(parted && centre.y <= middle ? farthest : centre.y);
    edges = vec4(in_buffer(nearer), in_buffer(centre.y), parted ? middle : NOTHING_MM,
                 differs > 0.0 || parted ? 1.0 : 0.0);
}
