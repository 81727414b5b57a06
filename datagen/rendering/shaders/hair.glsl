// Strands: hair, brows and lashes. Textures hold red: grey (0.5 on average), green: alpha, blue and alpha: cosine and
// sine of twice the angle of the strands in the texture, as bytes.
// numbers: 0 hair, 1 brows and lashes; density (1: as the texture has it); height below which it is cut (mm);
// how much of the crown is thin or bald, 0..1.

uniform vec3 hair_tips, hair_highlight, hair_grey;  // linear
uniform vec4 hair_mix;    // shares of grey and of highlighted strands, how dark the roots are, contrast of strands
uniform vec4 hair_reach;  // heights (mm) where the tips' colour begins and where it is full; a random number
in vec2 at_waves;         // smooth noise, 0..1: in patches, and along strands
const vec3 CROWN = vec3(0.0, 128.0, -25.0);

// Of strands, in space: the texture's direction, carried over by how position and texture change from pixel to pixel.
vec3 strand_direction(vec3 position, vec2 uv, vec2 twice) {
    vec2 along = vec2(sqrt(max(0.5 + 0.5 * twice.x, 0.0)) * (twice.y < 0.0 ? -1.0 : 1.0),
                      sqrt(max(0.5 - 0.5 * twice.x, 0.0)));
    vec3 px = dFdx(position), py = dFdy(position);
    vec2 ux = dFdx(uv), uy = dFdy(uv);
    vec3 across_u = px * uy.y - py * ux.y, across_v = py * ux.x - px * uy.x;
    vec3 direction = across_u * along.x + across_v * along.y;
    return direction / max(length(direction), 1e-9);
}

Surface hair_material(Surface s, vec2 uv) {
#ifdef SHADOW
    vec4 texel = textureLod(material_texture, vec3(uv, float(material_layer)), 2.0);  // as coarse as the map
#else
    vec4 texel = texture(material_texture, vec3(uv, float(material_layer)));
#endif
    texel = has_texture ? texel : vec4(0.5, 1.0, 0.0, 0.5);
    bool is_hair = material_numbers.x < 0.5;
    float grey = texel.r;
#ifdef SHADOW
    float patch_noise = 0.5, streak_noise = 0.5;  // a shadow's edge is wider than a strand
#else
    float patch_noise = at_waves.x, streak_noise = at_waves.y;
#endif

    float tips = smoothstep(hair_reach.x, hair_reach.y, s.position.y + 30.0 * (streak_noise - 0.5));
    float roots = hair_mix.z * smoothstep(105.0, 140.0, s.position.y);
    float lights = hair_mix.y * 1.2 - (0.35 * (1.0 - grey) + 0.65 * streak_noise);
    vec3 colour = mix(material_colour, hair_tips, tips);
    colour = mix(colour, hair_highlight, smoothstep(-0.3, 0.3, lights));
    colour = is_hair ? mix(colour, material_colour * 0.55, roots) : material_colour;
    // Strand by strand: in broad patches grey hair looks like snow.
    float greying = hair_mix.x - (0.75 * (1.0 - grey) + 0.25 * patch_noise);
    colour = mix(colour, hair_grey, smoothstep(-0.45, 0.45, greying) * smoothstep(0.0, 0.05, hair_mix.x));
    s.albedo = colour * mix(1.0, 2.0 * grey, hair_mix.w);

    float density = material_numbers.y;
    float alpha = clamp(texel.g + (density - 1.0) * (1.5 - grey) * smoothstep(0.0, 0.15, texel.g), 0.0, 1.0);
    float cut = s.position.y + 9.0 * (streak_noise - 0.5) + 8.0 * (grey - 0.5) - material_numbers.z;
    alpha *= smoothstep(-2.0, 2.0, cut);
    float bare = material_numbers.w * 95.0 - distance(s.position, CROWN) * (0.85 + 0.3 * patch_noise);
    alpha *= material_numbers.w > 0.0 ? 1.0 - 0.97 * smoothstep(-25.0, 5.0, bare) : 1.0;
    s.alpha *= alpha;
    s.occlusion *= mix(0.6, 1.0, clamp(2.0 * grey, 0.0, 1.0));
    vec3 direction = strand_direction(s.position, uv, texel.ba * 2.0 - 1.0);
    s.tangent = is_hair ? direction : vec3(0.0);
    return s;
}
