// What painting a surface gives to lighting it. Model frame, mm, linear colours.

struct Surface {
    vec3 position;
    vec3 normal;     // unit, on the side of the camera, with fine detail
    vec3 smooth_normal;  // unit, on the side of the camera, of the mesh alone
    vec3 tangent;    // along strands of hair; 0 where there are none
    vec3 albedo;
    float alpha;
    float roughness;
    float reflectance;  // at normal incidence
    float scatter;   // 0 opaque, 1 skin: light enters, reddens, leaves beside
    float occlusion; // 1 open to the sky, 0 closed in: how much ambient light arrives
};
