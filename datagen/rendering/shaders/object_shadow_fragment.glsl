// Where an object is more opaque than not, light stops.

void main() {
    if (painted(towards_camera_of(at_position)).alpha < 0.5) discard;
}
