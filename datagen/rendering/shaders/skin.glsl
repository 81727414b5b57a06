// Stands in until the skin is painted: one colour.

Surface skin(Surface s, vec2 uv, vec3 place, vec4 paint0, vec4 paint1, float pixel_mm) {
    s.albedo = vec3(0.6, 0.4, 0.3);
    return s;
}
