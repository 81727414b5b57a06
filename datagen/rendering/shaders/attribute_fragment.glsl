// Any quantity given at the corners of the triangles, interpolated over the face.

uniform sampler2D values;
uniform usampler2D corners;  // of each triangle, in numbers of `values`
uniform bool is_direction;

layout(location = 0) out vec4 interpolated;

void main() {
    Sight sight = look(gl_FragCoord.xy);
    uvec3 corner = texelFetch(corners, texel(sight.triangle), 0).xyz;
    vec4 value = sight.weight.x * texelFetch(values, texel(corner.x), 0)
               + sight.weight.y * texelFetch(values, texel(corner.y), 0)
               + sight.weight.z * texelFetch(values, texel(corner.z), 0);
    float size = length(value);
    if (is_direction && size > 0.0) value /= size;
    interpolated = sight.is_face ? value : vec4(0.0);
}
