// Cloth, metal, plastic, paper, skin of hands and shoulders; and glass.

const float NEUTRAL = 0.8;  // of a texture's red: the colour as it is

// Textures hold no colours: red is how light a place is, green the share of the second colour, blue how dull it is.
// numbers: the second colour (linear) and how much light scatters below the surface (1: skin).
Surface object_material(Surface s, vec2 uv) {
    float size = float(textureSize(material_texture, 0).x);
    vec4 texel = textureLod(material_texture, vec3(uv, float(material_layer)), max(texture_lod(size), 0.0));
    texel = has_texture ? texel : vec4(NEUTRAL, 0.0, 1.0, 1.0);
    s.albedo = mix(material_colour, material_numbers.rgb, texel.g) * (texel.r / NEUTRAL);
    s.alpha *= texel.a;
    s.roughness *= mix(0.6, 1.0, texel.b);
    s.scatter = material_numbers.w;
    return s;
}

// numbers: light that a coating mirrors at a right angle (0: bare glass), how much darker the lens is above than
// below, thickness of the rim that looks darker. Colour and alpha: what the glass itself looks like.
Surface glass_material(Surface s, vec2 uv, vec3 towards_camera) {
    float cosine = clamp(dot(s.normal, towards_camera), 0.0, 1.0);
    float grazing = 1.0 - cosine;
    float bare = 0.08;  // both sides of the pane
    float mirror = max(material_numbers.x, bare);
    float fresnel = mirror + (1.0 - mirror) * grazing * grazing * grazing * grazing * grazing;
    vec3 coating = mix(vec3(1.0), material_colour, smoothstep(bare, 0.3, material_numbers.x));
    glass_radiance = mirrored(reflect(-towards_camera, s.normal)) * coating * min(fresnel, 0.95);
    s.alpha *= mix(1.0 + material_numbers.y, 1.0 - material_numbers.y, clamp(uv.y, 0.0, 1.0));
    s.alpha = clamp(max(s.alpha, fresnel), 0.0, 0.985);
    s.albedo = material_colour * 0.3;
    return s;
}
