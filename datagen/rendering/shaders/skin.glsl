// What the head is painted with: skin, EYES, or the inside of the MOUTH, a program each. Where detail is finer than a pixel, the textures' coarser levels fade it.

uniform sampler2DArray skin_atlas, skin_details, skin_noise, skin_iris;
uniform vec4 skin_atlas_box, skin_details_box;  // u and v where they begin, and 1 / their extent
uniform vec3 skin_surface_colour, skin_dermis, skin_melanin_axis, skin_haemoglobin_axis;  // see skin/tone.py
uniform vec3 skin_layers, skin_layer_weights;
uniform float skin_contrast;                    // of the skins' texture
uniform vec4 skin_tone;                         // melanin, haemoglobin, flush, circles under the eyes
uniform vec4 skin_blotches;                     // of melanin, of haemoglobin; offset of the noise
uniform vec4 skin_freckles;                     // how many, how dark, of age, white patches
uniform vec4 skin_finish;                       // pores, oil, roughness, tan
uniform vec4 skin_wrinkles[2];                  // forehead, between brows, around eyes, around the mouth; left, right
uniform float skin_lip_lines;
const int MAX_SPOTS = 12;
uniform vec4 skin_spots[MAX_SPOTS];             // place on the mean head, radius in mm; 0 where there is none
uniform int skin_spot_count;
uniform vec4 skin_spot_paint[MAX_SPOTS];        // melanin, haemoglobin, height, hardness of the edge
uniform vec4 skin_lipstick, skin_eye_shadow, skin_blusher;  // linear colour, strength
uniform vec2 skin_make_up;                      // gloss of the lips, eyeliner
uniform vec4 skin_face_paint_a, skin_face_paint_b;  // linear colour; kind and strength
uniform vec3 skin_hair_colour, skin_beard_colour, skin_brow_colour;
uniform float skin_scalp_hair, skin_brow_strength, skin_hairline;  // 0 bald .. 1 dense; painted brows; receding
uniform vec2 skin_beard;                        // shaved shadow, stubble

const float UV_MM = 650.0;                      // the outside of the head, unrolled

// 0 at ``from``, 1 at ``to``, smooth between, whichever is larger (smoothstep is undefined for falling ramps).
float ramp(float from, float to, float x) {
    float t = clamp((x - from) / (to - from), 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

// Whole levels cost half: nothing is mixed between two.
float level(float texels_per_uv) {
    return floor(texture_lod(texels_per_uv) + 0.5);
}

vec3 skin_colour(float melanin, float haemoglobin) {
    return skin_surface_colour + skin_dermis * exp(-melanin * skin_melanin_axis - haemoglobin * skin_haemoglobin_axis);
}

vec3 skin_ratio(vec2 uv) {
    vec2 at = (uv - skin_atlas_box.xy) * skin_atlas_box.zw;
    float lod = level(512.0);
    vec3 code = skin_layer_weights.x * textureLod(skin_atlas, vec3(at, skin_layers.x), lod).rgb
              + skin_layer_weights.y * textureLod(skin_atlas, vec3(at, skin_layers.y), lod).rgb
              + skin_layer_weights.z * textureLod(skin_atlas, vec3(at, skin_layers.z), lod).rgb;
    return mix(vec3(1.0), 2.25 * code * code, skin_contrast);
}

float near(vec2 a, vec2 b, vec2 radius) {
    vec2 d = (a - b) / radius;
    return exp(-dot(d, d));
}

vec3 face_painted(vec3 colour, vec3 place, float noise) {
    float kind = skin_face_paint_b.x, x = abs(place.x), edge = 4.0 * (noise - 0.5);
    float face = ramp(-5.0, 15.0, place.z);
    float stripes = ramp(0.1, 0.3, sin((place.y + 0.3 * x + edge) * 0.55))
                  * step(abs(place.y + 14.0), 16.0) * step(26.0, x);
    float half_face = ramp(-1.0, 1.0, place.x + edge);
    float eyes = ramp(17.0, 14.0, length(vec2((x - 31.0) * 0.8, place.y - 28.0)) + edge);
    float band = ramp(13.0, 11.0, abs(place.y - 27.0) + edge);
    float star = ramp(7.0, 5.5, length(vec2(place.x - 44.0, place.y + 16.0)) + 2.0 * edge);
    float where = kind < 1.5 ? stripes : kind < 2.5 ? half_face : kind < 3.5 ? 1.0 : kind < 4.5 ? band : star;
    float second = kind > 2.5 && kind < 3.5 ? eyes : 0.0;
    vec3 paint = mix(skin_face_paint_a.rgb, skin_face_paint_b.yzw, second);
    return mix(colour, paint, where * face * skin_face_paint_a.w * (0.75 + 0.5 * (noise - 0.5)));
}

Surface outside_of_head(Surface s, vec2 uv, vec3 place, vec4 paint0, vec4 paint1) {
    float lips = ramp(0.15, 0.75, paint0.x), lid_mm = 24.0 * paint0.y, ear = paint0.z, cavity = paint0.w;
    float flush = paint1.x, oil = paint1.y, beard = paint1.z;
    vec2 mm = uv * UV_MM;
    vec4 spotted = textureLod(skin_noise, vec3(mm / 96.0 + skin_blotches.zw, 0.0), level(UV_MM / 96.0 * 256.0));
    vec4 wide = textureLod(skin_noise, vec3(mm.yx / 430.0 + skin_blotches.wz, 0.0), level(UV_MM / 430.0 * 256.0));
    vec4 fine = textureLod(skin_noise, vec3(mm / 20.0, 1.0), level(UV_MM / 20.0 * 256.0));
    vec2 at = (uv - skin_details_box.xy) * skin_details_box.zw;
    vec4 details = textureLod(skin_details, vec3(at, 0.0), level(1536.0));
    vec2 inside = step(abs(at - 0.5), vec2(0.498));
    details.zw *= inside.x * inside.y;
    float x = abs(place.x), y = place.y;

    // Melanin and blood.
    float front = ramp(0.0, 40.0, place.z), sun = front * (0.45 + 0.55 * ramp(75.0, 20.0, abs(y - 5.0)));
    float melanin = skin_tone.x * (1.0 + skin_blotches.x * (wide.r + spotted.b - 1.0) + skin_finish.w * (sun - 0.5));
    float haemoglobin = skin_tone.y * (1.0 + skin_blotches.y * (2.0 * wide.b + spotted.r - 1.5)) + skin_tone.z * flush;
    float freckles = ramp(1.0 - skin_freckles.x, 1.12 - 0.6 * skin_freckles.x, spotted.g);
    melanin += skin_freckles.y * freckles * sun;
    melanin += skin_freckles.z * ramp(0.66, 0.78, wide.b + 0.25 * (spotted.b - 0.5)) * sun;
    float circle = ramp(13.0, 3.0, lid_mm) * ramp(27.0, 20.0, y) * (1.0 - lips);
    melanin += 0.10 * skin_tone.w * circle * (0.3 + skin_tone.x);
    haemoglobin += 0.16 * skin_tone.w * circle + 0.10 * ramp(3.0, 0.0, lid_mm) + 0.22 * lips;
    melanin *= 1.0 - 0.12 * lips;
    vec3 towards = vec3(0.0);
    int spot = 0;
    do {
        vec3 away = (place - skin_spots[spot].xyz) * vec3(1.0, 1.0, 0.35);  // the depth of a place is a guess
        float size = max(skin_spots[spot].w, 1e-3), ratio = length(away) / size + 0.5 * (spotted.b - 0.5);
        float amount = ramp(1.0, skin_spot_paint[spot].w, ratio);
        melanin += amount * skin_spot_paint[spot].x;
        haemoglobin += amount * skin_spot_paint[spot].y;
        towards += skin_spot_paint[spot].z * amount * min(ratio, 1.0) / size * away;
    } while (++spot < skin_spot_count);
    melanin *= 1.0 - skin_freckles.w * ramp(0.60, 0.615, wide.r + 0.12 * (spotted.b - 0.5));

    // Folds deepen by where they lie.
    float forehead = ramp(54.0, 60.0, y), below = ramp(10.0, 5.0, y), middle = ramp(15.0, 11.0, x);
    vec4 folds = mix(skin_wrinkles[1], skin_wrinkles[0], ramp(-8.0, 8.0, place.x));
    float fold = mix(mix(folds.z, folds.y, middle), folds.x, forehead);
    float perioral = ramp(17.5, 16.0, x) * ramp(-22.0, -24.0, y) * ramp(-59.0, -57.0, y);
    fold = mix(fold, mix(folds.w, skin_lip_lines, perioral), below) * (1.0 - lips);
    float groove = clamp(details.z * fold, 0.0, 1.0);
    haemoglobin += 0.10 * groove;

    vec3 ratio = skin_ratio(uv);
    vec3 albedo = skin_colour(max(melanin, 0.0), max(haemoglobin, 0.0)) * ratio;
    albedo *= 1.0 + skin_finish.x * (0.35 * (fine.b - 0.5) + 0.25 * (fine.a - 0.5));
    albedo *= (1.0 - 0.42 * groove) * (1.0 - 0.5 * cavity);

    // Hair that is too short for strands.
    float dots = ramp(0.15, 0.6, spotted.a);
    float shaved = beard * skin_beard.x * (0.8 + 0.8 * (spotted.b - 0.5));
    albedo *= mix(vec3(1.0), vec3(0.66, 0.69, 0.72), shaved);
    float stubble = beard * skin_beard.y * (0.45 + 1.3 * dots) * (0.5 + wide.b);
    albedo = mix(albedo, skin_beard_colour, min(stubble, 0.95));
    float ragged = 0.16 * (spotted.b - 0.5) + 0.2 * (wide.b - 0.5);
    float line = ramp(0.42, 0.60, paint1.w - 0.35 * skin_hairline * front + ragged);
    float bare = clamp(1.0 - skin_scalp_hair, 0.0, 1.0), dense = 1.0 - bare * sqrt(bare);
    float crop = min(line * dense * mix(0.55 + 0.9 * dots, 1.0, dense), 0.985);
    albedo = mix(albedo, skin_hair_colour * (0.7 + 0.6 * fine.a), crop);
    float brow = clamp(1.25 * details.w * skin_brow_strength, 0.0, 0.95);
    albedo = mix(albedo, skin_brow_colour, brow);

    // Make-up and paint.
    float shade = clamp(luminance(ratio), 0.4, 1.3);
    float lid = ramp(15.0, 2.0, lid_mm + 3.0 * (spotted.b - 0.5)) * ramp(24.0, 31.0, y) * ramp(58.0, 46.0, x);
    albedo = mix(albedo, skin_eye_shadow.rgb * shade, skin_eye_shadow.a * lid);
    float cheek = near(vec2(x, y), vec2(47.0, -9.0 + 0.35 * (x - 47.0)), vec2(17.0, 11.0)) * step(10.0, place.z);
    albedo = mix(albedo, skin_blusher.rgb * shade, skin_blusher.a * cheek);
    albedo = mix(albedo, vec3(0.012, 0.010, 0.010), skin_make_up.y * ramp(2.2, 0.8, lid_mm));
    albedo = mix(albedo, skin_lipstick.rgb * (0.55 + 0.45 * shade) * (1.0 - 0.2 * groove), skin_lipstick.a * lips);
#ifndef ORDINARY
    albedo = skin_face_paint_a.w > 0.0 ? face_painted(albedo, place, spotted.b) : albedo;
#endif

    // Relief and shine.
    vec3 n = s.smooth_normal;
    vec3 along = normalize(cross(n, vec3(0.11, 0.99, 0.07))), across = cross(n, along);
    vec3 tilt = 1.1 * fold * vec3(2.0 * details.xy - 1.0, 0.0) * inside.x * inside.y + 0.8 * towards;
    tilt += skin_finish.x * 0.9 * ((fine.r - 0.5) * along + (fine.g - 0.5) * across);
    tilt += lips * 0.5 * (spotted.b - 0.5) * vec3(1.0, 0.0, 0.0);
    s.normal = normalize(n + tilt - n * dot(n, tilt));
    float wet = lips * (0.25 + skin_make_up.x) + ramp(1.6, 0.2, lid_mm) * 0.6;
    float sheen = skin_finish.y * (0.35 + 0.65 * oil) * (1.0 - 0.7 * crop) * (0.8 + 0.4 * spotted.b);
    s.roughness = clamp(skin_finish.z - 0.30 * sheen - 0.25 * wet + 0.1 * (fine.b - 0.5) + 0.2 * crop, 0.14, 0.9);
    s.reflectance = 0.028 + 0.026 * sheen + 0.015 * wet;
    s.scatter = (1.0 - 0.8 * crop) * (1.0 - 0.6 * skin_face_paint_a.w) * (1.0 + 0.8 * ear);
    s.albedo = clamp(albedo, 0.004, 0.95);
    return s;
}

// Of the eyes, by side (0 the subject's left).
uniform vec4 skin_lid_frame[2];   // middle of the corners, half of their distance, slope (model frame, mm)
uniform vec4 skin_lid_arch[2];    // height of the upper lid over their line and its skew, of the lower lid
uniform vec3 skin_eye_inner[2], skin_eye_outer[2];  // colour of the iris around the pupil, and of the rest
uniform vec4 skin_eye;            // size of the pupil, layer of the iris, limbal ring, redness
uniform vec4 skin_sclera;         // colour, veins
uniform float skin_iris_size;
const vec3 EYE_CENTRE = vec3(30.32, 28.94, 77.99), EYE_AXIS = vec3(0.0312, -0.0949, 0.9950);

Surface eye(Surface s, vec2 uv, vec3 place) {
    float side = place.x > 0.0 ? 1.0 : -1.0;
    int which = side > 0.0 ? 0 : 1;
    vec3 d = normalize(place * vec3(side, 1.0, 1.0) - EYE_CENTRE), axis = normalize(EYE_AXIS);
    vec2 aside = vec2(d.x - axis.x * d.z / axis.z, d.y - axis.y * d.z / axis.z);
    float radius = d.z > 0.0 ? length(aside) / skin_iris_size : 9.0, pupil = skin_eye.x;
    vec2 turned = normalize(aside + 1e-5);
    float fibre = 0.36 + 0.58 * clamp((radius - pupil) / (1.0 - pupil), 0.0, 1.0);
    float lod = texture_lod(96.0 * 2.0 / 0.0185);
    float code = textureLod(skin_iris, vec3(0.5 + 0.5 * fibre * turned * vec2(side, 1.0), skin_eye.y), lod - 1.5).r;
    float ratio = 2.25 * code * code;
    vec3 inner = skin_eye_inner[which], outer = skin_eye_outer[which];
    float blur = max(0.05, 1.2 * uv_per_pixel / 0.006);
    vec3 iris = mix(inner, outer, ramp(pupil + 0.05, pupil + 0.35, radius)) * (0.35 + 0.65 * ratio);
    iris *= 1.0 - skin_eye.z * ramp(0.72, 0.98, radius);
    iris *= ramp(pupil - 0.5 * blur, pupil + 0.5 * blur, radius);
    float white = ramp(1.0 - 0.7 * blur, 1.0 + 0.7 * blur, radius);

    vec4 frame = skin_lid_frame[which], arch = skin_lid_arch[which];
    float t = (s.position.x - frame.x) / frame.z;              // -1 the right corner in the picture of a frontal face
    float line = frame.y + frame.w * (s.position.x - frame.x), open = max(1.0 - t * t, 0.0);
    float above = line + open * (arch.x + arch.y * t) - s.position.y;    // mm below the upper lid
    float below = s.position.y - line - open * (arch.z + arch.w * t);   // mm above the lower lid
    float inward = -side * t;                                   // 1 at the nose

    float veins = textureLod(skin_noise, vec3(d.xy * 0.9 + skin_blotches.zw, 1.0), 1.0 + max(lod - 1.0, 0.0)).a;
    float bloodshot = skin_sclera.a * ramp(0.60, 0.75, veins) * ramp(0.9, 2.0, radius)
                    + skin_eye.w * (0.25 + 0.4 * ramp(0.3, 1.0, abs(t)));
    vec3 sclera = skin_sclera.rgb * exp(-bloodshot * vec3(0.10, 0.75, 0.65));
    vec3 flesh = skin_colour(0.25 * skin_tone.x, 0.9) * vec3(0.95, 0.9, 0.9);
    sclera = mix(sclera, flesh, ramp(0.80, 0.97, inward));
    vec3 albedo = mix(iris, sclera, white);
    float shade = (0.45 + 0.55 * ramp(-0.5, 4.5, above)) * (0.75 + 0.25 * ramp(-0.5, 1.5, below));
    albedo *= mix(shade, 1.0, 0.15);
    // What would stick out of the lids is covered by them.
    float covered = ramp(0.9, 1.6, max(-above, -below)) * step(0.0, d.z);
    s.albedo = mix(max(albedo, 0.004), skin_colour(skin_tone.x, skin_tone.y + 0.1) * 0.9, covered);
    s.roughness = mix(mix(0.09, 0.16, white), 0.5, covered);
    s.reflectance = mix(0.035, 0.028, covered);
    s.scatter = mix(0.35 * white, 1.0, covered);
    s.occlusion *= mix(shade, 1.0, covered);
    return s;
}

uniform vec4 skin_teeth;          // colour; gaps
uniform vec4 skin_teeth_odd;      // which tooth is missing, which is gold (from the middle, 0 none), braces, stain
uniform vec3 skin_tongue;
uniform float skin_mouth_open;    // 0..1: how much light falls in

Surface inside_of_mouth(Surface s, vec2 uv, vec3 place, float lips) {
    float depth = max(93.0 - place.z, 0.0), x = abs(place.x);
    bool is_teeth = uv.x > 0.67 && uv.x < 0.745 && uv.y < 0.13, is_upper = uv.y > 0.102;
    bool is_tongue = uv.x < 0.66 && uv.x > 0.5 && uv.y < 0.09, is_socket = uv.x < 0.2;
    vec3 flesh = skin_colour(0.12 * skin_tone.x, 0.75) * vec3(0.80, 0.75, 0.80);
    vec3 albedo = is_tongue ? skin_tongue : flesh;
    float rough = is_tongue ? 0.38 : 0.3;
    // Teeth by their width along the arch, from the middle.
    float along = x + 0.35 * max(90.0 - place.z, 0.0);
    float number = 0.0, from = 0.0, to = 0.0;
    float widths[6] = float[6](8.8, 7.0, 8.0, 7.4, 7.2, 11.0), lower[6] = float[6](0.62, 0.86, 0.92, 0.95, 1.0, 1.0);
    for (int i = 0; i < 6; ++i) {
        float wide = widths[i] * (is_upper ? 1.0 : lower[i]);
        from = along >= to ? to : from;
        number = along >= to ? float(i + 1) : number;
        to = along >= to ? to + wide : to;
    }
    float gap = min(along - from, to - along);
    float tall = is_upper ? place.y + 39.0 - 0.0035 * x * x : -43.8 + 0.0062 * x * x - place.y;
    float crown = 10.5 - 1.6 * pow(clamp(1.0 - gap / 4.0, 0.0, 1.0), 2.0);
    float gum = ramp(crown - 0.5, crown + 0.5, tall);
    vec3 tooth = skin_teeth.rgb * (1.0 - skin_teeth_odd.w * ramp(2.0, 10.0, tall)) * (1.0 - 0.04 * number);
    tooth *= mix(1.0, ramp(0.1, 0.9, gap), 0.35 + 0.65 * skin_teeth.a);
    float signed_number = place.x > 0.0 ? number : -number;
    bool is_missing = abs(signed_number - skin_teeth_odd.x) < 0.5 && is_upper;
    bool is_gold = abs(signed_number - skin_teeth_odd.y) < 0.5 && is_upper;
    tooth = is_gold ? vec3(0.75, 0.50, 0.16) : is_missing ? vec3(0.03, 0.008, 0.008) : tooth;
    float metal = skin_teeth_odd.z * max(step(abs(tall - 5.0), 0.5), step(abs(tall - 5.0), 1.6) * step(1.9, gap));
    tooth = mix(tooth, vec3(0.55), metal);
    albedo = is_teeth ? mix(tooth, flesh * 1.15, gum) : albedo;
    rough = is_teeth ? mix(0.16, 0.3, gum) : rough;
    // Lips go on inside; behind them it grows dark.
    vec3 lip = skin_colour(0.8 * skin_tone.x, skin_tone.y + 0.35);
    albedo = is_teeth || is_tongue ? albedo : mix(albedo, lip, lips * 0.8);
    float light = is_socket ? 0.7 : exp(-depth / mix(14.0, 26.0, skin_mouth_open)) * mix(0.9, 1.0, lips);
    s.albedo = clamp(albedo * mix(0.06, 1.0, light), 0.003, 0.9);
    // The occlusion is that of shut lips; a smile leaves the front teeth in the open.
    s.occlusion = is_teeth ? mix(s.occlusion, 1.0, 0.8) * mix(0.2, 1.0, light) : s.occlusion * mix(0.1, 1.0, light);
    s.roughness = (is_gold || metal > 0.5) && is_teeth ? 0.25 : rough;
    s.reflectance = (is_gold || metal > 0.5) && is_teeth ? 0.4 * light : 0.04 * light;
    s.scatter = is_teeth ? 0.3 : 0.7;
    return s;
}

Surface skin(Surface s, vec2 uv, vec3 place, vec4 paint0, vec4 paint1, float pixel_mm) {
#if defined(EYES)
    return eye(s, uv, place);
#elif defined(MOUTH)
    return inside_of_mouth(s, uv, place, ramp(0.0, 0.6, paint0.x));
#else
    return outside_of_head(s, uv, place, paint0, paint1);
#endif
}
