// Water that reflects the sky only.

fn mirrored_at(s: Surface, direction: vec3<f32>, sky: vec3<f32>) -> vec3<f32> {
    return sky;
}
