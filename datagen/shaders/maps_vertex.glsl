#version 330 core
// Projects a vertex and carries what the maps hold of it. A camera that mirrors or has perspective needs nothing else.

uniform mat4 clip_from_model;
uniform vec4 depth_from_model;  // depth in mm, relative to the nearest vertex: float32 keeps its precision far away

in vec3 vertex;
in vec3 mean;

out vec3 pncc;
out vec3 offset;
out float depth;

void main() {
    gl_Position = clip_from_model * vec4(vertex, 1.0);
    pncc = mean;
    offset = vertex - mean;
    depth = dot(depth_from_model, vec4(vertex, 1.0));
}
