// A pixel of the head.

const float INSIDE = 0.3;  // of the light that falls outside arrives inside the head, seen through the neck

in vec3 at_position, at_normal;
in vec2 at_uv;
in vec3 at_place;
in vec4 at_paint0, at_paint1;
in float at_occlusion;

layout(location = 0) out vec4 radiance;

void main() {
    float side = gl_FrontFacing ? 1.0 : -1.0;
    vec3 towards_camera = towards_camera_of(at_position);
    Surface s;
    s.position = at_position;
    s.smooth_normal = s.normal = normalize(at_normal) * side;
    s.tangent = vec3(0.0);
    s.albedo = vec3(0.5);
    s.alpha = 1.0;
    s.roughness = 0.5;
    s.reflectance = 0.04;
    s.scatter = 0.0;
    s.occlusion = at_occlusion;
    uv_per_pixel = max(length(dFdx(at_uv)), length(dFdy(at_uv)));
    float pixel_mm = pixel_size_mm(1.0 / gl_FragCoord.w, dot(s.normal, towards_camera));
    s = skin(s, at_uv, at_place, at_paint0, at_paint1, pixel_mm);
    vec3 colour = light(s, towards_camera);
    radiance = vec4(colour * (gl_FrontFacing ? 1.0 : INSIDE), 1.0);
}
