// A vertex of which nothing but the place counts.

uniform mat4 clip_from_model;

invariant gl_Position;  // depth is drawn by one program and compared by another

in vec3 vertex;

void main() {
    gl_Position = clip_from_model * vec4(vertex, 1.0);
}
