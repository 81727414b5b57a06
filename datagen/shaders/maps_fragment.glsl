#version 330 core
// Face triangles are drawn first, so their number tells them from the others. The inside of the surface is never face.

const float FACE = 1.0;
const float NOT_FACE = 0.5;  // background is 0

uniform int face_triangles;

in vec3 pncc;
in vec3 offset;
in float depth;

layout(location = 0) out vec4 pncc_and_kind;
layout(location = 1) out vec4 offset_and_depth;

void main() {
    bool is_face = gl_PrimitiveID < face_triangles && gl_FrontFacing;
    pncc_and_kind = is_face ? vec4(pncc, FACE) : vec4(0.0, 0.0, 0.0, NOT_FACE);
    offset_and_depth = is_face ? vec4(offset, depth) : vec4(0.0, 0.0, 0.0, depth);
}
