// Stands in until there is light: the first shadow-casting light and an even sky.

vec3 light(Surface s, vec3 towards_camera) {
    float cosine = max(dot(s.normal, shadow_lights[0]), 0.0);
    return s.albedo * (0.8 * cosine * shadow(0, s.position, s.smooth_normal)
                       + 0.3 * s.occlusion * sky(s.position, s.smooth_normal));
}

vec3 mirrored(vec3 direction) {
    return vec3(0.5 + 0.5 * direction.y);
}
