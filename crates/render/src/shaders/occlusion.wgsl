// Shared by all occlusion estimators: receivers, rotations and the final openness. Each estimator's file has
// `occlusion_sums`, which returns the occluded and the total weight; depth is looked up in the picture (whole.wgsl) or
// in a layer (layers.wgsl). CPU reference: cpu_reference/occlusion/mod.rs.

// Something counts as an occluder from this height above the tangent plane on, as a fraction of the radius (SSAO) or of
// its distance (all others); keeps flat and gently curved surfaces clean.
const MIN_ELEVATION: f32 = 0.03;

// The pixel whose occlusion is estimated.
struct Receiver {
    pixel: vec2<i32>,
    depth: f32,
    centre: vec3<f32>, // view space
    normal: vec3<f32>,
    radius: f32,
    rotation: u32, // which of 16
}

// Any two directions perpendicular to n (Duff et al., "Building an orthonormal basis, revisited",
// 2017).
fn basis(n: vec3<f32>) -> mat3x3<f32> {
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    return mat3x3(vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3(b, s + n.y * n.y * a, -n.y), n);
}

// Which of the 16 rotations a pixel uses: a 4x4 Bayer matrix, turned on with each frame of a mean.
fn rotation_index(pixel: vec2<i32>) -> u32 {
    let x = u32(pixel.x) & 3u;
    let y = u32(pixel.y) & 3u;
    let xy = x ^ y;
    let own = ((xy & 1u) << 3u) | ((y & 1u) << 2u) | (xy & 2u) | ((y & 2u) >> 1u);
    return (own + (frame.flags >> 8u)) & 15u;
}

// Falloff of an occluder: linear up to the radius.
fn falloff(r: Receiver, distance: f32) -> f32 {
    return max(1.0 - distance / r.radius, 0.0);
}

// What of an occluder counts that a march meets on the way from one place to the next, both from the receiver: a surface is
// taken to run straight between them, and counts by its falloff in the mean of its ends and twice its middle. So a ball
// hides what it stands on, though of the next sample on it nothing counts any more. What lies as far from the last as one
// radius to two is less and less its surface, and counts where it is: what stands far before a wall has no halo there.
fn met_between(r: Receiver, last: vec3<f32>, to: vec3<f32>) -> f32 {
    let here = falloff(r, length(to));
    // Nothing was drawn there, or this is the first.
    if (all(last == vec3(0.0))) {
        return here;
    }
    let mean = 0.25 * (here + falloff(r, length(last))) + 0.5 * falloff(r, 0.5 * length(last + to));
    return here + clamp(2.0 - length(to - last) / r.radius, 0.0, 1.0) * max(mean - here, 0.0);
}

// Where along a march a pixel's samples lie, 0..1 between two: each of 16 once, in another order than rotations.
fn march_offset(r: Receiver) -> f32 {
    return (f32((r.rotation * 5u + 3u) & 15u) + 0.5) / 16.0;
}

// Openness of a pixel, with the rotation of another pixel.
fn open_at(pixel: vec2<i32>, place: vec2<i32>) -> f32 {
    let depth = depth_at(pixel);
    let radius = radius_at(depth);
    if (depth >= FAR || radius * frame.scale_px < MIN_RADIUS_PX * depth) {
        return 1.0;
    }
    let centre = view_ray(pixel) * depth;
    let receiver = Receiver(pixel, depth, centre, receiver_normal(pixel, centre), radius, rotation_index(place));
    let sums = occlusion_sums(receiver);
    return clamp(1.0 - frame.occlusion_strength * sums.x / sums.y, 0.0, 1.0);
}
