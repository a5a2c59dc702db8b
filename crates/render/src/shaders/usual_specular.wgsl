// In place of specular.wgsl, where no material of a frame sets it.

fn specular_at(pixel: vec2<i32>, normal: vec3<f32>) -> Specular {
    return USUAL_SPECULAR;
}
