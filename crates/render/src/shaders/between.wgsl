// Bilinear lookup for upscaling.

// The nearest four, and how far between them: bilinear, texel centres lying at halves.
struct Between {
    a: vec2<i32>,
    b: vec2<i32>,
    part: vec2<f32>,
}

// Width and height of the target.
fn shown_size() -> vec2<f32> {
    return vec2(f32(frame.target_px & 0xffffu), f32(frame.target_px >> 16u));
}

fn between(at: vec2<f32>, size: vec2<f32>) -> Between {
    let place = at * size / shown_size() - 0.5;
    let low = vec2<i32>(floor(place));
    let last = vec2<i32>(size) - 1;
    return Between(clamp(low, vec2(0), last), clamp(low + 1, vec2(0), last), fract(place));
}
