// How deep the head is at the centre of each pixel that shows it.

uniform sampler2D seen;          // triangle and depth; three samples a pixel across, shared with the neighbours
uniform vec4 depth_from_buffer;  // mm: (x d + y) / (z d + w)

void main() {
    vec2 here = texelFetch(seen, 2 * ivec2(gl_FragCoord.xy) + 1, 0).xy;
    if (here.x <= 0.0) discard;
    gl_FragDepth = (depth_from_buffer.w * here.y - depth_from_buffer.y)
                 / (depth_from_buffer.x - depth_from_buffer.z * here.y);
}
