// Ambient occlusion in screen space: samples in the hemisphere above the surface, rotated per
// pixel in a 4x4 pattern (after Mittring, "Finding next gen: CryEngine 2", 2007, with the normal-
// oriented hemisphere of Filion and McNaughton, "StarCraft II effects and techniques", 2008), then a
// 4x4 blur that cancels the pattern. Twin: twin/ssao.rs.

@group(0) @binding(2) var raw_map: texture_2d<f32>;

// A neighbour counts as an occluder from this height above the tangent plane on, as a fraction of
// the radius; keeps flat and gently curved surfaces clean.
const MIN_ELEVATION: f32 = 0.03;
// Below this radius in pixels there is nothing to see.
const MIN_RADIUS_PX: f32 = 1.0;
// Above it the samples are too scattered to make sense.
const MAX_RADIUS_PX: f32 = 256.0;

// Any two directions perpendicular to n (Duff et al., "Building an orthonormal basis, revisited",
// 2017).
fn basis(n: vec3<f32>) -> mat3x3<f32> {
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    return mat3x3(vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3(b, s + n.y * n.y * a, -n.y), n);
}

// Which of the 16 rotations a pixel uses: a 4x4 Bayer matrix.
fn rotation_index(pixel: vec2<i32>) -> u32 {
    let x = u32(pixel.x) & 3u;
    let y = u32(pixel.y) & 3u;
    let xy = x ^ y;
    return ((xy & 1u) << 3u) | ((y & 1u) << 2u) | (xy & 2u) | ((y & 2u) >> 1u);
}

fn radius_at(depth: f32) -> f32 {
    let wanted = frame.occlusion_radius_world + frame.occlusion_radius_depth * depth;
    return min(wanted, MAX_RADIUS_PX * depth / frame.scale_px);
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
    let normal = normal_at(pixel, centre);
    let frame_of = basis(normal);
    let angle = f32(rotation_index(pixel)) * (2.0 * PI / 16.0);
    let turn = vec2(cos(angle), sin(angle));

    var occluded = 0.0;
    for (var i = 0u; i < frame.occlusion_samples; i++) {
        let k = frame.kernel[i].xyz;
        let turned = vec3(k.x * turn.x - k.y * turn.y, k.x * turn.y + k.y * turn.x, k.z);
        let sample = centre + frame_of * turned * radius;
        if (sample.z >= 0.0) {
            continue; // behind the eye
        }
        let ndc = sample.xy / (frame.tan_half_fov * -sample.z);
        if (any(abs(ndc) >= vec2(1.0))) {
            continue; // outside the picture: nothing known
        }
        let uv = vec2(ndc.x * 0.5 + 0.5, 0.5 - ndc.y * 0.5);
        let there = vec2<i32>(uv * frame.size_px - frame.jitter);
        let depth_there = depth_at(there);
        let surface = view_ray(there) * depth_there;
        let hides = depth_there < -sample.z && dot(surface - centre, normal) > MIN_ELEVATION * radius;
        if (hides) {
            // Things far in front of the surface do not shade it.
            occluded += smoothstep(0.0, 1.0, radius / max(abs(depth - depth_there), 1e-30));
        }
    }
    let open = 1.0 - frame.occlusion_strength * occluded / f32(frame.occlusion_samples);
    return vec4(clamp(open, 0.0, 1.0));
}

// Mean of the 4x4 neighbours that lie at about the same depth; every window holds each rotation
// once.
@fragment
fn fs_blur(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    let depth = depth_at(pixel);
    if (depth >= FAR) {
        return vec4(1.0);
    }
    let reach = radius_at(depth);
    let last = vec2<i32>(frame.size_px) - 1;
    var sum = 0.0;
    var weight = 0.0;
    for (var y = -1; y <= 2; y++) {
        for (var x = -1; x <= 2; x++) {
            let p = clamp(pixel + vec2(x, y), vec2(0), last);
            if (abs(depth_at(p) - depth) <= reach) {
                sum += textureLoad(raw_map, p, 0).x;
                weight += 1.0;
            }
        }
    }
    return vec4(sum / max(weight, 1.0));
}
