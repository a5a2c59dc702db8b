// Search of relief mapping: linear, then binary (Policarpo, Oliveira, Comba, "Real-time relief mapping on arbitrary
// polygonal surfaces", 2005).

// Fraction of the way from `start` (surface) to `start + span` (full depth) at which the ray meets the height field.
fn relief_trace(start: vec2<f32>, span: vec2<f32>, lod: f32, steps: f32) -> f32 {
    let last = relief_steps(start, span, lod, steps);
    return relief_halved(start, span, lod, last.below - 1.0 / steps, last.below);
}

// Where the ray meets the height field: in depths, and as a fraction of `span`. `lengths`: depth, and reach at full
// depth.
fn relief_intersection(uv: vec2<f32>, span: vec2<f32>, lod: f32, steps: f32, lengths: vec2<f32>) -> vec2<f32> {
    return vec2(relief_found(uv, span, lod, steps));
}
