// In place of lights.wgsl, where a frame has no punctual lights.

fn from_punctual_lights(r: Reflector, position: vec3<f32>, pixel: vec2<u32>, depth: f32) -> vec3<f32> {
    return vec3(0.0);
}
