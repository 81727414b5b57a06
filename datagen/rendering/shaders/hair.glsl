// Stands in until hair is painted: what the mesh's material says.

Surface hair_material(Surface s, vec2 uv) {
    vec4 texel = texture(material_texture, vec3(uv, float(material_layer)));
    s.albedo *= has_texture ? linear_of(texel.rgb) : vec3(1.0);
    s.alpha *= has_texture ? texel.a : 1.0;
    return s;
}
