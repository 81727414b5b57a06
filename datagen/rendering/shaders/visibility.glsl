// What the samples around a pixel's centre see: at -1/2, 0 and 1/2 px in each direction, the outer ones shared.

const float NOTHING_MM = 1e7;

uniform sampler2D seen;  // x: triangle of the head from 1, an object's label below 0, nothing 0; y: depth, mm

vec2 seen_at(ivec2 fine) {  // what (1 the head), depth in mm
    vec2 found = texelFetch(seen, fine, 0).xy;
    return vec2(min(found.x, 1.0), found.x == 0.0 ? NOTHING_MM : found.y);
}
