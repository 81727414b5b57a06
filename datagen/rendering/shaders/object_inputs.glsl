// What an object is made of: set for each mesh.

uniform vec3 material_colour;
uniform float material_alpha, material_roughness, material_reflectance;
uniform vec4 material_numbers;
uniform sampler2DArray material_texture;
uniform int material_layer;
uniform bool has_texture;

vec3 glass_radiance = vec3(0.0);  // what a glass mirrors, in addition, not multiplied by alpha
