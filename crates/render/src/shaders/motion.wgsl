// Motion vectors in pixels: from a surface's position to its previous position.

// What holds the motion of things by themselves says this of all others.
const STANDS: f32 = 6e4;

// Where a place, relative to this frame's eye, was in the frame before, in pixels of a picture without jitter; at
// infinity for directions (w = 0). Behind that frame's eye: nowhere (-1e9).
fn place_before(world: vec4<f32>) -> vec2<f32> {
    let clip = frame.before * world;
    if (clip.w <= 0.0) {
        return vec2(-1e9);
    }
    return (clip.xy / clip.w * vec2(0.5, -0.5) + 0.5) * frame.size_px;
}

// Where a pixel shows what it shows, likewise: at its centre but for this frame's jitter.
fn place_now(pixel: vec2<i32>) -> vec2<f32> {
    return vec2<f32>(pixel) + 0.5 + frame.jitter;
}

// Motion of still surfaces, due to the camera.
fn motion_of_camera(pixel: vec2<i32>, stored: f32) -> vec2<f32> {
    let ray = (transpose(frame.view_from_world) * vec4(view_ray(pixel), 0.0)).xyz;
    let there = stored > 0.0;
    let distance = select(1.0, frame.near / max(stored, 1e-38), there);
    return place_before(vec4(ray * distance, select(0.0, 1.0, there))) - place_now(pixel);
}
