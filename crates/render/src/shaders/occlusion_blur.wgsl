// The 4x4 blur that cancels the pattern of occlusion's rotations. CPU reference: cpu_reference/occlusion/blur.rs.

@group(0) @binding(2) var raw_map: texture_2d<f32>;

// Mean of the 4x4 neighbours that lie at about the same depth; every window holds each rotation
// once. The more rotations a pixel has had itself, over frames, the more of it is its own.
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
    let own = f32(max(frame.flags >> 12u, 1u) - 1u) / 15.0;
    return vec4(mix(sum / max(weight, 1.0), textureLoad(raw_map, pixel, 0).x, own));
}
