// A vertex of strands: what changes slowly along them is worked out here, since every pixel shows many layers of them.

uniform mat4 clip_from_model;
uniform vec4 camera_place;

invariant gl_Position;  // depth is drawn by one program and compared by another

in vec3 vertex;
in vec3 normal;
in vec2 uv;

out vec3 at_position;
out vec3 at_normal;
out vec2 at_uv;
out vec3 at_reached;  // of two lamps and the sky

void main() {
    gl_Position = clip_from_model * vec4(vertex, 1.0);
    at_position = vertex;
    at_normal = normal;
    at_uv = uv;
#ifndef SHADOW
    vec3 seen_side = normal * (dot(normal, camera_place.xyz - camera_place.w * vertex) < 0.0 ? -1.0 : 1.0);
    at_reached = vec3(lamp_reaches(0, vertex, seen_side, 0.0), lamp_reaches(1, vertex, seen_side, 0.0), sky(vertex, seen_side));
#else
    at_reached = vec3(1.0);
#endif
}
