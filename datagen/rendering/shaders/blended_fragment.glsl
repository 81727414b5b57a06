// A pixel of an object that is transparent in parts: colour multiplied by alpha. At the edge of something opaque it lies
// over the nearer surface there, over the farther one, or over both.

uniform sampler2D edges;  // x: depth of the nearer surface in the pixel; y: of what is at its centre
uniform float label;

layout(location = 0) out vec4 over_near;
layout(location = 1) out vec4 over_far;
layout(location = 2) out vec4 seen;

void main() {
    vec3 towards_camera = towards_camera_of(at_position);
    Surface s = painted(towards_camera);
    float alpha = clamp(s.alpha, 0.0, 1.0);
    if (alpha < 0.004) discard;
    vec2 depths = texelFetch(edges, ivec2(gl_FragCoord.xy), 0).xy;
    over_far = vec4(light(s, towards_camera) * alpha + glass_radiance, alpha);
    over_near = gl_FragCoord.z <= depths.x ? over_far : vec4(0.0);
    seen = gl_FragCoord.z <= depths.y && alpha > 0.5 ? vec4(label, 0.0, 0.0, 1.0) : vec4(0.0);
}
