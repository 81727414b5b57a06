
uniform mat4 clip_from_model;

in vec3 vertex;
in vec3 normal;
in vec4 paint;  // albedo (linear light) and gloss: 0 dull skin, 1 the wet surface of an eye

out vec3 surface_normal;
out vec4 surface_paint;

void main() {
    gl_Position = clip_from_model * vec4(vertex, 1.0);
    surface_normal = normal;
    surface_paint = paint;
}
