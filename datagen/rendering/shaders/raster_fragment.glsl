// Which triangle is nearest at each pixel centre, by the depth test of OpenGL.

layout(location = 0) out uint seen;

void main() {
    seen = uint(gl_PrimitiveID);
}
