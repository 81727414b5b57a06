// Light on opaque surfaces: two lamps with shadows, everything else as nine harmonics, and environments for what
// mirrors. Model frame. HAIR has its shadows from its vertices.

const int MAX_PANORAMAS = 2;
const float PI = 3.14159265;
const float MIRRORS = 0.4;      // rougher surfaces mirror what the harmonics know
const float BRIGHTEST = 12.0;   // of a highlight

#ifdef HAIR
in vec3 at_reached;             // of two lamps and the sky
#endif

uniform vec3 light_sh[9];       // 1, x, y, z, xy, yz, 3 z^2 - 1, xz, x^2 - y^2
uniform float light_sky_share;  // of the ambient light that sky() takes away where it is shut
uniform float light_size[MAX_LAMPS];     // sine of the angular radius
uniform sampler2DArray light_panoramas;  // without lamps; two layers each: as it is, and soft
uniform int light_panorama_count;
uniform int light_panorama_layer[MAX_PANORAMAS];
uniform mat3 light_panorama_turn[MAX_PANORAMAS];    // environment from model
uniform mat3 light_panorama_matrix[MAX_PANORAMAS];  // of colours

vec3 first_band(vec3 d) {
    return light_sh[1] * d.x + light_sh[2] * d.y + light_sh[3] * d.z;
}

vec3 second_band(vec3 d) {
    return light_sh[4] * (d.x * d.y) + light_sh[5] * (d.y * d.z) + light_sh[6] * (3.0 * d.z * d.z - 1.0)
         + light_sh[7] * (d.x * d.z) + light_sh[8] * (d.x * d.x - d.y * d.y);
}

// Ambient irradiance / pi.
vec3 ambient_light(vec3 normal) {
    return max(light_sh[0] + (2.0 / 3.0) * first_band(normal) + 0.25 * second_band(normal), vec3(0.0));
}

// One layer of the environments in a direction.
vec3 panorama(vec3 direction, float softness) {
    vec3 found = vec3(0.0);
    int i = 0;
    do {
        vec3 d = light_panorama_turn[i] * direction;
        vec2 place = vec2(atan(d.x, d.z) / (2.0 * PI) + 0.5, acos(clamp(-d.y, -1.0, 1.0)) / PI);
        float layer = float(light_panorama_layer[i]);
        vec3 sharp = textureLod(light_panoramas, vec3(place, layer), 0.0).rgb;
        vec3 soft = textureLod(light_panoramas, vec3(place, layer + 1.0), 0.0).rgb;
        found += max(light_panorama_matrix[i] * mix(sharp, soft, softness), vec3(0.0));
    } while (++i < light_panorama_count);
    return found;
}

// What a rough surface mirrors: a lobe of GGX of width alpha leaves exp(-l (l + 1) alpha^2) of band l, nearly.
vec3 ambient_lobe(vec3 direction, float alpha) {
    float first = exp(-2.0 * alpha * alpha);
    return max(light_sh[0] + first * first_band(direction) + first * first * first * second_band(direction), vec3(0.0));
}

vec3 ambient_mirrored(vec3 direction, float roughness) {
    vec3 rough = ambient_lobe(direction, max(roughness * roughness, 0.08));
#ifdef HAIR
    return rough;  // no strand is wide enough to mirror a picture, and hair is drawn in many layers
#endif
    if (light_panorama_count == 0 || roughness >= MIRRORS) return rough;
    vec3 sharp = panorama(direction, clamp(roughness / 0.32, 0.0, 1.0));
    return mix(sharp, rough, smoothstep(0.3, MIRRORS, roughness));
}

// The environment and the lamps themselves in a direction.
vec3 mirrored(vec3 direction) {
    vec3 found = ambient_mirrored(direction, 0.0);
    for (int i = 0; i < MAX_LAMPS; ++i) {
        float edge = sqrt(max(1.0 - light_size[i] * light_size[i], 0.0));
        float inside = smoothstep(edge - 0.002, edge + 0.25 * (1.0 - edge) + 1e-4, dot(direction, light_direction[i]));
        found += inside * min(light_colour[i] / max(light_size[i] * light_size[i], 1e-3), vec3(BRIGHTEST));
    }
    return found;
}

vec3 fresnel(float reflectance, float cosine) {
    float away = 1.0 - clamp(cosine, 0.0, 1.0);
    float squared = away * away;
    return vec3(mix(reflectance, min(50.0 * reflectance, 1.0), squared * squared * away));
}

// GGX for a lamp of some size: the nearest of its points to the mirrored ray stands for it.
// Source: Karis 2013, Real Shading in Unreal Engine 4.
vec3 highlight(Surface s, vec3 towards_camera, int i, float view_cosine) {
    vec3 ray = reflect(-towards_camera, s.normal);
    vec3 aside = dot(light_direction[i], ray) * ray - light_direction[i];
    vec3 nearest = light_direction[i] + aside * min(light_size[i] / max(length(aside), 1e-4), 1.0);
    nearest = normalize(nearest);
    float cosine = dot(s.normal, nearest);
    if (cosine <= 0.0) return vec3(0.0);
    vec3 halfway = normalize(nearest + towards_camera);
    float alpha = max(s.roughness * s.roughness, 0.012);
    float wide = min(alpha + 0.5 * light_size[i], 1.0);
    float h = max(dot(s.normal, halfway), 0.0);
    float d = h * h * (alpha * alpha - 1.0) + 1.0;
    // alpha^2 / (pi d^2), times alpha^2 / wide^2 for the energy of a wide lamp; pi goes with irradiance / pi.
    float lobe = alpha * alpha * alpha * alpha / (d * d * wide * wide);
    float k = 0.5 * alpha;
    float masked = 0.25 / ((cosine * (1.0 - k) + k) * (view_cosine * (1.0 - k) + k));
    vec3 mirror = fresnel(s.reflectance, dot(nearest, halfway));
    return min(light_colour[i] * mirror * (lobe * masked * cosine), vec3(BRIGHTEST));
}

// Two highlights along strands of hair: one white and near the root's side, one coloured by the hair.
// Source: Kajiya and Kay 1989; Scheuermann 2004, after Marschner et al. 2003.
vec3 strand_light(Surface s, vec3 towards_camera, int i) {
    vec3 halfway = normalize(light_direction[i] + towards_camera);
    vec3 shifted = normalize(s.tangent - 0.10 * s.normal), back = normalize(s.tangent + 0.18 * s.normal);
    float first = sqrt(max(1.0 - dot(shifted, halfway) * dot(shifted, halfway), 0.0));
    float second = sqrt(max(1.0 - dot(back, halfway) * dot(back, halfway), 0.0));
    float sharp = mix(180.0, 12.0, clamp(s.roughness, 0.0, 1.0));
    vec3 colour = sqrt(max(s.albedo, vec3(0.0)));
    float facing = clamp(dot(s.normal, light_direction[i]) + 0.3, 0.0, 1.0);
    return light_colour[i] * facing * (s.reflectance * 2.5 * pow(first, sharp) + 0.22 * colour * pow(second, 0.3 * sharp));
}

// Light of one lamp on matt skin or cloth: red wanders farthest below the skin, so it follows the smooth shape, and
// reaches around the edge of the light.
vec3 matt_light(Surface s, int i, float reaches) {
    float scatter = min(s.scatter, 1.0);
    float fine = dot(s.normal, light_direction[i]), smooth_cosine = dot(s.smooth_normal, light_direction[i]);
    vec3 cosine = mix(vec3(fine), vec3(smooth_cosine), scatter * vec3(0.8, 0.5, 0.3));
    vec3 wrap = scatter * vec3(0.20, 0.09, 0.05);
    vec3 lit = max(cosine + wrap, vec3(0.0)) / ((1.0 + wrap) * (1.0 + wrap));
    vec3 shaded = vec3(mix(reaches, sqrt(reaches), 0.35 * scatter), reaches, reaches);
    return light_colour[i] * lit * shaded;
}

// Light from behind through what is thin: ears, nostrils (scatter above 1).
vec3 shine_through(Surface s, int i, float thin, float reaches) {
    float behind = max(-dot(s.smooth_normal, light_direction[i]) + 0.2, 0.0) / 1.2;
    return light_colour[i] * (thin * behind * reaches) * vec3(0.55, 0.12, 0.05);
}

vec3 light(Surface s, vec3 towards_camera) {
    float view_cosine = clamp(dot(s.normal, towards_camera), 0.02, 1.0);
    float thin = clamp(s.scatter - 1.0, 0.0, 1.0);
    bool is_hair = dot(s.tangent, s.tangent) > 0.0;
#ifdef HAIR
    float open = s.occlusion * mix(1.0, at_reached.z, light_sky_share);
#else
    float open = s.occlusion * mix(1.0, sky(s.position, s.smooth_normal), light_sky_share);
#endif
    vec3 soft_normal = normalize(mix(s.normal, s.smooth_normal, 0.5 * min(s.scatter, 1.0)));
    // Light that is reflected within a hollow takes on its colour. Source: Jimenez et al. 2016, Practical Real-Time
    // Strategies for Accurate Indirect Occlusion, Eq. 34.
    vec3 hollow = max(vec3(open), ((open * (2.0404 * s.albedo - 0.3324) - 4.7951 * s.albedo + 0.6417) * open
                                   + 2.7552 * s.albedo + 0.6903) * open);
    vec3 matt = ambient_light(soft_normal) * hollow;
    // Ambient light mirrored. Source: Karis 2014, Physically Based Shading on Mobile.
    vec4 r = s.roughness * vec4(-1.0, -0.0275, -0.572, 0.022) + vec4(1.0, 0.0425, 1.04, -0.04);
    float edge = min(r.x * r.x, exp2(-9.28 * view_cosine)) * r.x + r.y;
    float share = s.reflectance * (-1.04 * edge + r.z) + (1.04 * edge + r.w) * min(50.0 * s.reflectance, 1.0);
    vec3 ray = reflect(-towards_camera, s.normal);
    vec3 shine = ambient_mirrored(ray, s.roughness) * (share * clamp(open * (1.0 + view_cosine) - 0.15, 0.0, 1.0));
    int lamp = 0, lamps = lamp_count();
    do {  // a lamp that is not there is not worked out: loops end where they do, ``if`` spares nothing
#ifdef HAIR
        float reaches = at_reached[lamp];
        matt += matt_light(s, lamp, reaches);
        shine += is_hair ? reaches * strand_light(s, towards_camera, lamp) : vec3(0.0);
#else
        float reaches = lamp_reaches(lamp, s.position, s.smooth_normal, thin);
        matt += matt_light(s, lamp, reaches) + shine_through(s, lamp, thin, reaches);
#ifdef NO_STRANDS
        shine += reaches * highlight(s, towards_camera, lamp, view_cosine);
#else
        shine += reaches * (is_hair ? strand_light(s, towards_camera, lamp) : highlight(s, towards_camera, lamp, view_cosine));
#endif
#endif
    } while (++lamp < lamps);
    return s.albedo * matt + shine;
}
