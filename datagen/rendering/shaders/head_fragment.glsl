// The head at the centre of each pixel that shows it: one shading a pixel, however small the triangles are. The test of
// depth leaves out all other pixels (scene_edges.py).

const float INSIDE = 0.3;  // of the light that falls outside arrives inside the head, seen through the neck

uniform sampler2D seen;            // triangle at the centre of each pixel, from 1 on
uniform usampler2D head_corners;   // of each triangle
uniform sampler2D head_positions;  // of each vertex: position and u; mm
uniform sampler2D head_normals;    // normal and v
uniform sampler2D head_places;     // position on the mean head, and occlusion
uniform sampler2D head_paint0, head_paint1;
uniform mat4 clip_from_model;
uniform vec2 half_size;   // of the picture, px
uniform float outside;    // sign of the area in the image of triangles that show their outside

layout(location = 0) out vec4 radiance;

ivec2 texel(uint index) {
    return ivec2(index & 1023u, index >> 10);  // width: see gl_mesh.py
}

void main() {
    float triangle = texelFetch(seen, ivec2(gl_FragCoord.xy), 0).x;
    uvec3 corner = texelFetch(head_corners, texel(uint(max(triangle, 1.0)) - 1u), 0).xyz;
    ivec2 ta = texel(corner.x), tb = texel(corner.y), tc = texel(corner.z);
    vec4 a = texelFetch(head_positions, ta, 0), b = texelFetch(head_positions, tb, 0);
    vec4 c = texelFetch(head_positions, tc, 0);
    vec4 na = texelFetch(head_normals, ta, 0), nb = texelFetch(head_normals, tb, 0), nc = texelFetch(head_normals, tc, 0);
    // Corners relative to the ray through the pixel, px times w: weights from them are those on the surface.
    vec2 place = gl_FragCoord.xy - half_size;
    vec4 ca = clip_from_model * vec4(a.xyz, 1.0), cb = clip_from_model * vec4(b.xyz, 1.0);
    vec4 cc = clip_from_model * vec4(c.xyz, 1.0);
    vec2 ra = ca.xy * half_size - place * ca.w, rb = cb.xy * half_size - place * cb.w;
    vec2 rc = cc.xy * half_size - place * cc.w;
    vec3 sides = vec3(rb.x * rc.y - rb.y * rc.x, rc.x * ra.y - rc.y * ra.x, ra.x * rb.y - ra.y * rb.x);
    float area = sides.x + sides.y + sides.z;
    // OpenGL moves vertices to a grid, so the centre may lie just outside: the nearest weights count.
    vec3 weight = max(sides * sign(area), 0.0);
    weight = area != 0.0 ? weight / (weight.x + weight.y + weight.z) : vec3(1.0 / 3.0);
    float w = dot(weight, vec3(ca.w, cb.w, cc.w));
    bool front = area * outside >= 0.0;

    Surface s;
    s.position = mat3(a.xyz, b.xyz, c.xyz) * weight;
    vec3 towards_camera = towards_camera_of(s.position);
    s.smooth_normal = normalize(mat3(na.xyz, nb.xyz, nc.xyz) * weight) * (front ? 1.0 : -1.0);
    s.normal = s.smooth_normal;
    s.tangent = vec3(0.0);
    s.albedo = vec3(0.5);
    s.alpha = 1.0;
    s.roughness = 0.5;
    s.reflectance = 0.04;
    s.scatter = 0.0;
    vec4 home = mat3x4(texelFetch(head_places, ta, 0), texelFetch(head_places, tb, 0), texelFetch(head_places, tc, 0))
        * weight;
    s.occlusion = home.w;
    float cosine = abs(dot(s.normal, towards_camera));
    vec2 uva = vec2(a.w, na.w), uvb = vec2(b.w, nb.w), uvc = vec2(c.w, nc.w);
    vec2 eb = uvb - uva, ec = uvc - uva;
    float uv_area = abs(eb.x * ec.y - eb.y * ec.x);
    float px_area = max(abs(area) / (w * w), 1e-6);  // of a triangle that is small in depth
    uv_per_pixel = sqrt(uv_area / px_area / max(cosine, 0.1));
    s = skin(s, mat3x2(uva, uvb, uvc) * weight, home.xyz,
             mat3x4(texelFetch(head_paint0, ta, 0), texelFetch(head_paint0, tb, 0), texelFetch(head_paint0, tc, 0)) * weight,
             mat3x4(texelFetch(head_paint1, ta, 0), texelFetch(head_paint1, tb, 0), texelFetch(head_paint1, tc, 0)) * weight,
             pixel_size_mm(w, cosine));
    radiance = vec4(light(s, towards_camera) * (front ? 1.0 : INSIDE), 1.0);
}
