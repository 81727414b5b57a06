// What the drawer tells every shader of a scene.

uniform vec4 camera_place;  // mm, w = 1: a pinhole stands there; w = 0: an affine camera looks from that direction
uniform float pixel_mm_at_1;  // size of a pixel in mm where the clip coordinate w is 1

float uv_per_pixel;  // of the surface that is being painted

vec3 towards_camera_of(vec3 position) {
    return normalize(camera_place.xyz - camera_place.w * position);
}

// Level of detail of a texture that has so many texels in one unit of uv.
float texture_lod(float texels_per_uv) {
    return log2(max(uv_per_pixel * texels_per_uv, 1e-6));
}

// Of a pixel on a surface seen at this cosine, mm; w: the clip coordinate.
float pixel_size_mm(float w, float cosine) {
    return pixel_mm_at_1 * w / max(abs(cosine), 0.2);
}
