// Colours, and numbers that look random but are the same on every driver.

float luminance(vec3 linear) {
    return dot(linear, vec3(0.2126, 0.7152, 0.0722));
}

// Whole numbers to 0..1: integers, since the sine of a large float differs between drivers.
float hash1(ivec3 cell) {
    uint h = uint(cell.x) * 1597334673u ^ uint(cell.y) * 3812015801u ^ uint(cell.z) * 2798796415u;
    h = (h ^ (h >> 15)) * 0x2c1b3c6du;
    h ^= h >> 13;
    return float(h >> 8) * (1.0 / 16777216.0);
}

// Value noise, 0..1, of wavelength 2 or so.
float noise3(vec3 p) {
    vec3 low = floor(p);
    vec3 t = p - low;
    t = t * t * (3.0 - 2.0 * t);
    ivec3 c = ivec3(low);
    vec4 near = vec4(hash1(c), hash1(c + ivec3(1, 0, 0)), hash1(c + ivec3(0, 1, 0)), hash1(c + ivec3(1, 1, 0)));
    c.z += 1;
    vec4 far = vec4(hash1(c), hash1(c + ivec3(1, 0, 0)), hash1(c + ivec3(0, 1, 0)), hash1(c + ivec3(1, 1, 0)));
    vec4 across = mix(near, far, t.z);
    vec2 along = mix(across.xy, across.zw, t.y);
    return mix(along.x, along.y, t.x);
}
