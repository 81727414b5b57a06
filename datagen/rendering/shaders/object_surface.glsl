// A pixel of an object, painted.

in vec3 at_position, at_normal;
in vec2 at_uv;

Surface painted(vec3 towards_camera) {
    vec3 along_x = dFdx(at_position), along_y = dFdy(at_position);
    vec3 face = cross(along_x, along_y);  // of the triangle, towards the camera
    face *= sign(dot(face, towards_camera));
    vec2 uv_x = dFdx(at_uv), uv_y = dFdy(at_uv);
    uv_per_pixel = max(length(uv_x), length(uv_y));
    Surface s;
    s.position = at_position;
    s.normal = normalize(at_normal);
    s.normal *= dot(s.normal, face) < 0.0 ? -1.0 : 1.0;  // both sides of a sheet
    s.smooth_normal = s.normal;
    s.tangent = vec3(0.0);
    s.albedo = material_colour;
    s.alpha = material_alpha;
    s.roughness = material_roughness;
    s.reflectance = material_reflectance;
    s.scatter = 0.0;
    s.occlusion = 1.0;
#if defined(HAIR)
    vec3 along_v = along_y * uv_x.x - along_x * uv_y.x;  // where u stays and v grows, up to a sign
    along_v *= uv_x.x * uv_y.y - uv_y.x * uv_x.y < 0.0 ? -1.0 : 1.0;
    s.tangent = along_v / max(length(along_v), 1e-12);
    return hair_material(s, at_uv);
#elif defined(GLASS)
    return glass_material(s, at_uv, towards_camera);
#else
    return object_material(s, at_uv);
#endif
}
