// Lambert's law, wrapped a little around the terminator as light does in skin, and Blinn's highlight. Model frame.

const int MAX_LIGHTS = 3;
const float WRAP = 0.15;
const float INSIDE = 0.35;  // the inside of the head, seen through the neck, lies in shadow

uniform vec3 light_directions[MAX_LIGHTS];  // towards the light; colour 0 where there is none
uniform vec3 light_colours[MAX_LIGHTS];
uniform vec3 ambient;
uniform vec3 towards_camera;
uniform float shine;

in vec3 surface_normal;
in vec4 surface_paint;

out vec4 colour;

vec3 srgb(vec3 linear) {
    vec3 low = 12.92 * linear;
    vec3 high = 1.055 * pow(max(linear, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055;
    return mix(low, high, step(0.0031308, linear));
}

void main() {
    vec3 normal = normalize(surface_normal) * (gl_FrontFacing ? 1.0 : -1.0);
    float gloss = surface_paint.a;
    float exponent = mix(14.0, 220.0, gloss);
    vec3 diffuse = ambient;
    vec3 highlight = vec3(0.0);
    for (int i = 0; i < MAX_LIGHTS; ++i) {
        float cosine = dot(normal, light_directions[i]);
        diffuse += light_colours[i] * max(cosine + WRAP, 0.0) / (1.0 + WRAP);
        vec3 halfway = normalize(light_directions[i] + towards_camera);
        highlight += light_colours[i] * pow(max(dot(normal, halfway), 0.0), exponent) * step(0.0, cosine);
    }
    vec3 light = surface_paint.rgb * diffuse + highlight * mix(shine, 0.6, gloss);
    colour = vec4(srgb(clamp(light * (gl_FrontFacing ? 1.0 : INSIDE), 0.0, 1.0)), 1.0);
}
