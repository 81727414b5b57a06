// A vertex of strands: what changes slowly along them is worked out here, since every pixel shows many layers of them.

uniform mat4 clip_from_model;
uniform vec4 camera_place;

in vec3 vertex;
in vec3 normal;
in vec2 uv;

out vec3 at_position;
out vec3 at_normal;
out vec2 at_uv;
out vec3 at_reached;  // of two lamps and the sky
out vec2 at_waves;    // see hair.glsl

uniform vec4 hair_reach;

// Smooth, 0..1; far cheaper than value noise, and so wide that the vertices of strands are near enough for it.
float waves(vec3 p) {
    return 0.5 + 0.25 * (sin(p.x + 1.7 * sin(0.7 * p.y + 1.3 * p.z)) + sin(p.z + 1.9 * sin(0.6 * p.x - 1.1 * p.y)));
}

void main() {
    gl_Position = clip_from_model * vec4(vertex, 1.0);
    at_position = vertex;
    at_normal = normal;
    at_uv = uv;
    at_waves = vec2(waves(vertex * 0.21 + hair_reach.z), waves(vertex * vec3(0.31, 0.05, 0.31) + hair_reach.z + 40.0));
#ifndef SHADOW
    vec3 seen_side = normal * (dot(normal, camera_place.xyz - camera_place.w * vertex) < 0.0 ? -1.0 : 1.0);
    at_reached = vec3(lamp_reaches(0, vertex, seen_side, 0.0), lamp_reaches(1, vertex, seen_side, 0.0), sky(vertex, seen_side));
#else
    at_reached = vec3(1.0);
#endif
}
