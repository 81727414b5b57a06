// A pixel of an object that hides what is behind.

layout(location = 0) out vec4 radiance;

void main() {
    vec3 towards_camera = towards_camera_of(at_position);
    Surface s = painted(towards_camera);
    radiance = vec4(light(s, towards_camera) + glass_radiance, 1.0);
}
