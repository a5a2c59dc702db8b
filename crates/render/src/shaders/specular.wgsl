// Specular reflection of dielectrics and clear coats, in frames with materials that set it.

@group(0) @binding(14) var specular_map: texture_2d<u32>;

fn specular_at(pixel: vec2<i32>, normal: vec3<f32>) -> Specular {
    return specular_of(textureLoad(specular_map, pixel, 0).xy, normal);
}
