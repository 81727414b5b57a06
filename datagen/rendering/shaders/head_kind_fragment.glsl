// Which of the programs that paint the head a pixel needs, as a depth: the test of depth is the only thing that spares a
// processor the work of a pixel. 0 none, then the outside, eyes, the inside of the mouth.

uniform sampler2D seen;           // triangle and depth; three samples a pixel across, shared with the neighbours
uniform usampler2D head_corners;  // of each triangle; and how it is painted

void main() {
    float triangle = texelFetch(seen, 2 * ivec2(gl_FragCoord.xy) + 1, 0).x;
    uint index = uint(max(triangle, 1.0)) - 1u;
    uint kind = texelFetch(head_corners, ivec2(index & 1023u, index >> 10), 0).w;  // width: see gl_mesh.py
    gl_FragDepth = triangle > 0.0 ? 0.25 * float(kind + 1u) : 0.0;
}
