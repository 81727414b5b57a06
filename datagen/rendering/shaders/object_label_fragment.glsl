// Whether an object is more opaque than not at a pixel: for labels and for shadows.

uniform bool is_blended;
uniform float label;

layout(location = 0) out float seen;

void main() {
    Surface s = painted(towards_camera_of(at_position));
    if (is_blended && s.alpha < 0.5) discard;
    seen = label;
}
