// What is nearest at a sample: the number of a triangle of the head from 1 on, an object's label
// below 0; and its depth.

uniform float object_label;  // negative; 0: the head

layout(location = 0) out vec4 seen;

void main() {
    seen = vec4(object_label < 0.0 ? object_label : float(gl_PrimitiveID + 1), gl_FragCoord.z, 0.0, 0.0);
}
