// One triangle over the whole viewport.

uniform float whole_depth;  // clip coordinate

void main() {
    gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, whole_depth, 1.0);
}
