// Where two surfaces share a pixel: the depth of the nearer, and (as depth) of the farther.

layout(location = 0) out vec4 edges;

void main() {
    ivec2 first = 2 * ivec2(gl_FragCoord.xy);
    vec3 centre = seen_at(first + 1);
    vec3 near = centre, far = centre;
    for (int i = 0; i < 9; ++i) {
        vec3 other = seen_at(first + ivec2(i % 3, i / 3));
        near = other.y < near.y ? other : near;
        far = other.y > far.y ? other : far;
    }
    bool parted = far.y - near.y > edge_mm;
    float middle = 0.5 * (min(far.y, near.y + 1000.0) + near.y);
    float nearer = parted && centre.y > middle ? near.z : centre.z;
    gl_FragDepth = parted && centre.y < middle ? far.z : centre.z;
    edges = vec4(nearer, centre.z, parted ? middle : NOTHING_MM, near.x != far.x || parted ? 1.0 : 0.0);
}
