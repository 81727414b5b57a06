// A vertex as the projection left it: nothing is interpolated but the depth, which is linear in the image.

uniform vec4 clip_from_screen;  // x, y: scale of column and row; z, w: scale and shift of the order

in vec3 position;

void main() {
    gl_Position = vec4(position.xy * clip_from_screen.xy - 1.0, position.z * clip_from_screen.z + clip_from_screen.w, 1.0);
}
