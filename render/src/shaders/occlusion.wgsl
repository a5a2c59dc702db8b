// What the estimators of ambient occlusion share: receivers, rotations, and what is made of their sums. Each has a file
// of its own with `occlusion_sums`, which gives how much is occluded, and of how much. Twin: twin/occlusion/mod.rs.

// Something counts as an occluder from this height above the tangent plane on, as a fraction of the radius (SSAO) or of
// its distance (all others); keeps flat and gently curved surfaces clean.
const MIN_ELEVATION: f32 = 0.03;

// A pixel whose occlusion is asked for.
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

// What of an occluder at this distance counts: linear to the radius, which is what points spread evenly along it find.
fn falloff(r: Receiver, distance: f32) -> f32 {
    return max(1.0 - distance / r.radius, 0.0);
}

// Where along a march a pixel's samples lie, 0..1 between two: each of 16 once, in another order than rotations.
fn march_offset(r: Receiver) -> f32 {
    return (f32((r.rotation * 5u + 3u) & 15u) + 0.5) / 16.0;
}

// Pixels to go for a share of the radius: from the next pixel on, since a sample in the own one finds nothing.
fn march_px(r: Receiver, share: f32) -> f32 {
    return mix(1.0, max(r.radius * frame.scale_px / r.depth, 1.0), share);
}

// What is drawn at an offset in pixels: from the receiver, view space. 0 outside of the picture, where nothing is known,
// in the pixel itself and in the sky.
fn drawn_at(r: Receiver, offset_px: vec2<f32>) -> vec3<f32> {
    let there = vec2<i32>(floor(vec2<f32>(r.pixel) + 0.5 + offset_px));
    if (any(there < vec2(0)) || any(there >= vec2<i32>(frame.size_px)) || all(there == r.pixel)) {
        return vec3(0.0);
    }
    let depth = depth_at(there);
    return select(view_ray(there) * depth - r.centre, vec3(0.0), depth >= FAR);
}

@fragment
fn fs_occlusion(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    let depth = depth_at(pixel);
    let radius = radius_at(depth);
    if (depth >= FAR || radius * frame.scale_px < MIN_RADIUS_PX * depth) {
        return vec4(1.0);
    }
    let centre = view_ray(pixel) * depth;
    let receiver = Receiver(pixel, depth, centre, normal_at(pixel, centre), radius, rotation_index(pixel));
    let sums = occlusion_sums(receiver);
    let open = 1.0 - frame.occlusion_strength * sums.x / sums.y;
    return vec4(clamp(open, 0.0, 1.0));
}
