// Upsampling of half-resolution occlusion, combined with the blur over the rotations. CPU reference:
// cpu_reference/occlusion/half.rs.

@group(0) @binding(2) var half_map: texture_2d<f32>;

// Mean of the 4x4 around a pixel, each of 2x2 pixels, of which that with an estimate lies at about the same depth; every
// window holds each rotation once. Where none does, the estimate that is nearest in depth.
@fragment
fn fs_upsample(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    let depth = depth_at(pixel);
    if (depth >= FAR) {
        return vec4(1.0);
    }
    let reach = radius_at(depth);
    let last = (vec2<i32>(frame.size_px) + 1) / 2 - 1;
    let first = (pixel + 1) / 2 - 2;
    var sum = 0.0;
    var weight = 0.0;
    var least = 2.0 * FAR;
    var nearest = 1.0;
    for (var y = 0; y < 4; y++) {
        for (var x = 0; x < 4; x++) {
            let cell = clamp(first + vec2(x, y), vec2(0), last);
            let off = abs(depth_at(half_pixel(cell)) - depth);
            let open = textureLoad(half_map, cell, 0).x;
            if (off <= reach) {
                sum += open;
                weight += 1.0;
            }
            if (off < least) {
                least = off;
                nearest = open;
            }
        }
    }
    return vec4(select(nearest, sum / max(weight, 1.0), weight > 0.0));
}
