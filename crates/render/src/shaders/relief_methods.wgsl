// Searches of relief mapping for comparison: relief_bisection.wgsl, a part of it, or offset limiting.

// Bits of frame.flags: search method.
const RELIEF_WAY_BIT: u32 = 2u;
const RELIEF_SECANT: u32 = 1u;
const RELIEF_STEEP: u32 = 2u;
const RELIEF_OFFSET: u32 = 3u;

// With more minification than this, in mip levels, linear steps replace a search with an acceleration texture, which
// exists for the finest level only: a ray crosses few texels then.
const RELIEF_FINEST: f32 = 0.5;

fn relief_way() -> u32 {
    return (frame.flags >> RELIEF_WAY_BIT) & 3u;
}

// Fraction of the way from `start` (surface) to `start + span` (full depth) at which the ray meets the height field.
fn relief_trace(start: vec2<f32>, span: vec2<f32>, lod: f32, steps: f32) -> f32 {
    let way = relief_way();
    let last = relief_steps(start, span, lod, steps);
    if (way == RELIEF_STEEP || (way == RELIEF_SECANT && (last.now > 0.0 || last.before <= last.now))) {
        return last.below;
    }
    let step = 1.0 / steps;
    let above = last.below - step;
    if (way == RELIEF_SECANT) {
        return above + step * clamp(last.before / (last.before - last.now), 0.0, 1.0);
    }
    return relief_halved(start, span, lod, above, last.below);
}

// Where the ray meets the height field: in depths, and as a fraction of `span`. `lengths`: depth, and reach at full
// depth.
fn relief_intersection(uv: vec2<f32>, span: vec2<f32>, lod: f32, steps: f32, lengths: vec2<f32>) -> vec2<f32> {
    if (relief_way() == RELIEF_OFFSET) {
        // Offset limiting: not divided by the cosine, so the shift is at most the depth.
        let below = 1.0 - relief_height(uv, lod);
        return vec2(below, below * lengths.x / lengths.y);
    }
    return vec2(relief_found(uv, span, lod, steps));
}
