// How much of each lamp reaches a point. Colours of lamps are what a white surface shows that faces them (irradiance / pi).

const int MAX_LAMPS = 2;
const float NARROWEST_EDGE_MM = 1.2;

uniform vec3 light_direction[MAX_LAMPS];
uniform vec3 light_colour[MAX_LAMPS];
uniform float light_edge_mm[MAX_LAMPS];  // of shadows
uniform int light_gobo;           // 0 none, 1 blinds, 2 leaves, 3 a window's bars
uniform vec3 light_gobo_axes[2];  // periods per mm
uniform vec2 light_gobo_shift;
uniform float light_gobo_depth, light_gobo_edge;

// What a pattern before the first lamp lets through, 0..1.
float gobo(vec3 point) {
    vec2 at = vec2(dot(light_gobo_axes[0], point), dot(light_gobo_axes[1], point)) + light_gobo_shift;
    float open;
    if (light_gobo == 1) {
        open = smoothstep(0.5 - light_gobo_edge, 0.5 + light_gobo_edge, abs(fract(at.y) * 2.0 - 1.0));
    } else if (light_gobo == 2) {
        float leaves = 0.65 * noise3(vec3(2.0 * at, 7.0)) + 0.35 * noise3(vec3(5.0 * at, 19.0));
        open = smoothstep(0.5 - 0.3 * light_gobo_edge, 0.5 + 0.3 * light_gobo_edge, leaves);
    } else {
        vec2 bar = abs(fract(at) * 2.0 - 1.0);
        float edge = max(light_gobo_edge * 0.5, 0.04);
        open = smoothstep(0.12, 0.12 + edge, bar.x) * smoothstep(0.12, 0.12 + edge, bar.y);
    }
    return 1.0 - light_gobo_depth * (1.0 - open);
}

// How much of a lamp reaches a point, 0..1; wide lamps have wide edges of shadows. What is thin lets light through from
// behind, so that only what is farther shades it.
float lamp_reaches(int i, vec3 point, vec3 normal, float thin) {
    float radius = light_edge_mm[i] / shadow_texel_mm;
    float cosine = dot(normal, light_direction[i]);
    float slope = sqrt(max(1.0 - cosine * cosine, 0.0));
    float offset = shadow_texel_mm * (0.5 + 1.5 * slope) + 0.4 * (light_edge_mm[i] - NARROWEST_EDGE_MM);
    vec3 raised = point + normal * offset + (14.0 * thin) * light_direction[i];
    float bias = 1.0 + 0.4 * (light_edge_mm[i] - NARROWEST_EDGE_MM);
    float found = lit_fraction(i, raised, bias, 0.75 * radius);
#ifndef ORDINARY
    return i == 0 && light_gobo > 0 ? found * gobo(point) : found;
#else
    return found;
#endif
}

// How many lamps there are to work out.
int lamp_count() {
    return light_colour[1] == vec3(0.0) ? 1 : 2;
}
