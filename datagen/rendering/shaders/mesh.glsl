// What every shader knows of the mesh. Triangles come in pairs that share an edge: pair i holds the triangles 2 i,
// (a, b, c), and 2 i + 1, (a, c, d). Textures instead of buffers: software drivers gather texels eight at a time.

uniform sampler2D screen;  // of each vertex: column and row in px, order in mm (linear in the image, larger is farther)
uniform usampler2D pairs;  // corners a, b, c, d; region numbers and flags in the bits above

const uint VERTEX_BITS = 24u;

ivec2 texel(uint index) {
    return ivec2(index & 1023u, index >> 10);  // width: see gl_mesh.py
}

vec3 on_screen(uint vertex) {
    return texelFetch(screen, texel(vertex), 0).xyz;
}
