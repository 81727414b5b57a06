// Something opaque is seen.

uniform float label;

layout(location = 0) out float seen;

void main() {
    seen = label;
}
