// PNCC, offset, depth and region of what a pixel sees. The point of this face is where the ray through the pixel centre
// meets the depth, so that only the mean is interpolated: pncc + offset lies on the ray exactly.

uniform sampler2D mean;  // of each vertex, mm
uniform vec2 middle;     // px; points below are taken relative to its ray, for float32's sake
uniform vec3 middle_point, along_column, along_row, along_depth;  // point of the middle at order 0; mm per px and mm

layout(location = 0) out vec4 pncc_and_region;   // w: 1 + region, negative where not face; 0 background
layout(location = 1) out vec4 offset_and_depth;  // w: relative to order 0, background infinite

vec3 mean_point(uint vertex) {
    return texelFetch(mean, texel(vertex), 0).xyz;
}

void main() {
    Sight sight = look(gl_FragCoord.xy);
    vec3 pncc = sight.weight.x * mean_point(sight.corner.x) + sight.weight.y * mean_point(sight.corner.y)
              + sight.weight.z * mean_point(sight.corner.z);
    vec2 aside = gl_FragCoord.xy - middle;
    vec3 across = aside.x * along_column + aside.y * along_row;
    vec3 point = middle_point + across + sight.depth * (along_depth + inverse_distance * across);
    float region = float(sight.region + 1u);
    float depth = sight.hit ? sight.depth : uintBitsToFloat(0x7f800000u);
    pncc_and_region = sight.is_face ? vec4(pncc, region) : vec4(vec3(0.0), sight.hit ? -region : 0.0);
    offset_and_depth = vec4(sight.is_face ? point - pncc : vec3(0.0), depth);
}
