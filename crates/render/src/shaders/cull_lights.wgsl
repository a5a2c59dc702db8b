// Tiled light culling: a bit per light, so none is lost and sums have one order. Without clusters, a tile's depth
// range narrows the lights (Andersson, "Parallel graphics in Frostbite", 2009); with clusters, depth bins do so per
// pixel (Drobot, "Improved culling for tiled and clustered rendering", 2017), and only the tile's farthest depth is
// needed. Transparent surfaces are in no depth buffer: they may lie anywhere before the opaque surface.

@group(0) @binding(1) var depth_map: texture_2d<f32>;
@group(0) @binding(8) var<storage, read_write> punctual_light_masks: array<u32>;

// Bits of positive floating-point numbers are ordered as these are.
var<workgroup> nearest_bits: atomic<u32>;
var<workgroup> furthest_bits: atomic<u32>;

const THREADS: u32 = 64;

@compute @workgroup_size(THREADS)
fn cs_cull(@builtin(workgroup_id) tile: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    if (thread == 0u) {
        atomicStore(&nearest_bits, bitcast<u32>(FAR));
        atomicStore(&furthest_bits, 0u);
    }
    workgroupBarrier();
    let corner = tile.xy * punctual_lights.tile_px;
    let size = vec2<u32>(frame.size_px);
    let end = min(corner + punctual_lights.tile_px, size);
    for (var i = thread; i < punctual_lights.tile_px * punctual_lights.tile_px; i += THREADS) {
        let pixel = corner + vec2(i % punctual_lights.tile_px, i / punctual_lights.tile_px);
        let stored = textureLoad(depth_map, min(pixel, size - 1u), 0).x;
        if (all(pixel < end) && (stored > 0.0 || punctual_lights.through == 1u)) {
            let bits = bitcast<u32>(view_depth(stored));
            atomicMin(&nearest_bits, bits);
            atomicMax(&furthest_bits, bits);
        }
    }
    workgroupBarrier();
    let furthest = bitcast<f32>(atomicLoad(&furthest_bits));
    let any_nearer = punctual_lights.clusters == 1u || punctual_lights.through == 1u;
    let nearest = select(bitcast<f32>(atomicLoad(&nearest_bits)), 0.0, any_nearer);

    // The tile's sides are planes through the eye: across = ray * depth.
    let low = view_ray(vec2<i32>(corner)).xy - frame.tan_half_fov * vec2(1.0, -1.0) / frame.size_px;
    let high = view_ray(vec2<i32>(end) - 1).xy + frame.tan_half_fov * vec2(1.0, -1.0) / frame.size_px;
    for (var word = thread; word < punctual_lights.words; word += THREADS) {
        var bits = 0u;
        for (var bit = 0u; bit < 32u && word * 32u + bit < punctual_lights.count; bit++) {
            let punctual_light = punctual_light_list[word * 32u + bit];
            let p = (frame.view_from_world * vec4(punctual_light.position, 0.0)).xyz;
            let inside = vec4(
                (p.x + low.x * p.z) * inverseSqrt(1.0 + low.x * low.x),
                -(p.x + high.x * p.z) * inverseSqrt(1.0 + high.x * high.x),
                -(p.y + low.y * p.z) * inverseSqrt(1.0 + low.y * low.y),
                (p.y + high.y * p.z) * inverseSqrt(1.0 + high.y * high.y),
            );
            let reached = all(inside >= vec4(-punctual_light.range)) && -p.z - punctual_light.range <= furthest && -p.z + punctual_light.range >= nearest;
            bits |= select(0u, 1u << bit, reached);
        }
        let at = (tile.y * punctual_lights.tiles_across + tile.x) * punctual_lights.words + word;
        punctual_light_masks[at] = bits;
    }
}
