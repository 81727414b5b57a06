// Which lights reach a point: depth maps seen from each light, side by side in one texture. Model frame, mm.

const int MAX_SHADOWS = 3;
const int SKY = 2;  // the third map: what is open to the sky
const float SKY_EXTENT = 0.5;  // its side, of the others': it is blurred anyway

uniform sampler2DShadow shadow_maps;
uniform mat4 shadow_from_model[MAX_SHADOWS];  // x, y: 0..1 over the map; z: depth 0..1
uniform vec3 shadow_lights[MAX_SHADOWS];      // towards the light
uniform int shadow_count;
uniform float shadow_texel_mm;
uniform float shadow_texel;                   // of the map's width
uniform float shadow_depth_mm;                // of the whole range of depth

float lit_fraction(int i, vec3 point, float depth_bias_mm, float radius_texels) {
    vec3 place = (shadow_from_model[i] * vec4(point, 1.0)).xyz;
    place.z -= depth_bias_mm / shadow_depth_mm;
    float extent = i == SKY ? SKY_EXTENT : 1.0;
    vec2 margin = vec2((radius_texels + 1.0 / extent) * shadow_texel);
    vec2 within = step(margin, place.xy) * step(place.xy, 1.0 - margin);
    vec2 across = vec2((extent * clamp(place.x, margin.x, 1.0 - margin.x) + float(i)) / float(MAX_SHADOWS),
                       extent * clamp(place.y, margin.y, 1.0 - margin.y));
    vec2 r = extent * radius_texels * shadow_texel * vec2(1.0 / float(MAX_SHADOWS), 1.0);
    // Four taps on a turned square, each of them the mean of four texels.
    float lit = texture(shadow_maps, vec3(across + r * vec2(0.92, 0.38), place.z))
              + texture(shadow_maps, vec3(across + r * vec2(-0.38, 0.92), place.z))
              + texture(shadow_maps, vec3(across + r * vec2(-0.92, -0.38), place.z))
              + texture(shadow_maps, vec3(across + r * vec2(0.38, -0.92), place.z));
    return i < shadow_count ? mix(1.0, 0.25 * lit, within.x * within.y) : 1.0;
}

// 0 in shadow, 1 lit by light i.
float shadow(int i, vec3 point, vec3 normal) {
    float cosine = dot(normal, shadow_lights[i]);
    float slope = sqrt(max(1.0 - cosine * cosine, 0.0));
    return lit_fraction(i, point + normal * (shadow_texel_mm * (0.4 + 1.2 * slope)), 1.0, 1.2);
}

// How open a point is to the sky, 0..1.
float sky(vec3 point, vec3 normal) {
    vec3 raised = point + normal * (2.0 * shadow_texel_mm + 2.0);
    return lit_fraction(SKY, raised, 2.0, 5.0);
}
