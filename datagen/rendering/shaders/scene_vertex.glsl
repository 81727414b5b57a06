// A vertex of an object.

uniform mat4 clip_from_model;

in vec3 vertex;
in vec3 normal;
in vec2 uv;

out vec3 at_position;
out vec3 at_normal;
out vec2 at_uv;

void main() {
    gl_Position = clip_from_model * vec4(vertex, 1.0);
    at_position = vertex;
    at_normal = normal;
    at_uv = uv;
}
