// A vertex of a head or of an object.

uniform mat4 clip_from_model;

in vec3 vertex;
in vec3 normal;
in vec2 uv;

out vec3 at_position;
out vec3 at_normal;
out vec2 at_uv;

#ifdef HEAD
in vec3 place;
in vec4 paint0, paint1;
in float occlusion;
out vec3 at_place;
out vec4 at_paint0, at_paint1;
out float at_occlusion;
#endif

void main() {
    gl_Position = clip_from_model * vec4(vertex, 1.0);
    at_position = vertex;
    at_normal = normal;
    at_uv = uv;
#ifdef HEAD
    at_place = place;
    at_paint0 = paint0;
    at_paint1 = paint1;
    at_occlusion = occlusion;
#endif
}
