// A pixel of an object: colour multiplied by alpha.

uniform bool is_blended;

layout(location = 0) out vec4 radiance;

void main() {
    vec3 towards_camera = towards_camera_of(at_position);
    Surface s = painted(towards_camera);
    float alpha = is_blended ? clamp(s.alpha, 0.0, 1.0) : 1.0;
    if (alpha < 0.004) discard;
    radiance = vec4(light(s, towards_camera) * alpha + glass_radiance, alpha);
}
