// Slices through the direction to the eye, which `gtao.wgsl` and `bitmask.wgsl` integrate over (Jimenez, Wu, Pesce and
// Jarabo, "Practical real-time strategies for accurate indirect occlusion", 2016, section 4). Directions are even about the
// eye's direction, not in the picture, so that nothing changes towards the edges of a wide one. CPU reference:
// cpu_reference/occlusion/slices.rs.

struct Slice {
    offset_px: vec2<f32>, // per unit of the world along the slice
    along: vec3<f32>, // perpendicular to the direction to the eye
    tangent: vec3<f32>, // of the surface, within the slice
    normal_length: f32, // of the normal's projection
    sine: f32, // of the angle from the direction to the eye to that projection, towards `along`
    cosine: f32,
    angle: f32,
}

// Number of slices for a number of samples, with eight steps to either side of each. Rotations turn slices, so that 16
// pixels or frames together have 16 times as many; but horizons are only as high as the samples find.
fn slice_count() -> u32 {
    return max((frame.occlusion_samples + 8u) / 16u, 1u);
}

fn step_count() -> u32 {
    return max(frame.occlusion_samples / (2u * slice_count()), 1u);
}

fn slice_of(r: Receiver, number: u32) -> Slice {
    let to_eye = -normalize(r.centre);
    let turn = PI * (f32(number) + f32(r.rotation) / 16.0) / f32(slice_count());
    let around = basis(to_eye);
    let along = around[0] * cos(turn) + around[1] * sin(turn);
    // First-order change of the screen position along the slice.
    let ray = r.centre.xy / r.depth;
    let offset = (along.xy + ray * along.z) * (frame.scale_px / r.depth);
    let projected = vec2(dot(r.normal, along), dot(r.normal, to_eye));
    let len = max(length(projected), 1e-6);
    let angle = atan2(projected.x, projected.y);
    let tangent = along * (projected.y / len) - to_eye * (projected.x / len);
    return Slice(vec2(offset.x, -offset.y), along, tangent, len, projected.x / len, projected.y / len, angle);
}

// Distance of a step in world units; denser near the receiver, where occluders count for more (XeGTAO).
fn step_length(r: Receiver, step: u32) -> f32 {
    let share = (f32(step) + march_offset(r)) / f32(step_count());
    return march_px(r, share * share) * r.depth / frame.scale_px;
}

// Position of a sample within the slice, along tangent and normal. Heights above the tangent plane are kept, so that a
// plane stays a plane even where pixels lie beside the slice.
fn within(r: Receiver, slice: Slice, to: vec3<f32>) -> vec2<f32> {
    return vec2(dot(to, slice.tangent), dot(to, r.normal) / slice.normal_length);
}

// Integral over the slice from the direction to the eye to an angle from it, of directions' weights: the cosine to the
// normal, and that slices are closer together near the middle (Jimenez et al. 2016, equation 7).
fn arc(slice: Slice, angle: f32) -> f32 {
    return 0.25 * (slice.cosine - cos(2.0 * angle - slice.angle) + 2.0 * angle * slice.sine);
}

// The signed integral.
fn signed_arc(slice: Slice, angle: f32) -> f32 {
    return select(-1.0, 1.0, angle >= 0.0) * arc(slice, angle);
}
