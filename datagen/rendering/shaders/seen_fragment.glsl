// What is nearest at a sample: the number of a triangle of the head from 1 on, or an object's label below 0; its depth.

uniform float object_label;  // negative; 0: the head
uniform vec4 depth_from_buffer;  // mm: (x d + y) / (z d + w)

layout(location = 0) out vec2 seen;

void main() {
    float d = gl_FragCoord.z;
    float depth = (depth_from_buffer.x * d + depth_from_buffer.y) / (depth_from_buffer.z * d + depth_from_buffer.w);
    seen = vec2(object_label < 0.0 ? object_label : float(gl_PrimitiveID + 1), depth);
}
