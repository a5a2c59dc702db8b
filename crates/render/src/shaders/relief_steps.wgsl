// Linear search of relief mapping, without an acceleration texture (relief.wgsl).
fn relief_found(start: vec2<f32>, span: vec2<f32>, lod: f32, steps: f32) -> f32 {
    return relief_trace(start, span, lod, steps);
}
