// Greatest depths of blocks of the map of undersides, which it shows from below.

@group(0) @binding(0) var undersides: texture_depth_2d_array;

const BLOCK: u32 = 16u;

@fragment
fn fs_lowest(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let first = vec2<u32>(at.xy) * BLOCK;
    var lowest = 0.0;
    for (var y = 0u; y < BLOCK; y++) {
        for (var x = 0u; x < BLOCK; x++) {
            lowest = max(lowest, textureLoad(undersides, first + vec2(x, y), 0, 0));
        }
    }
    return vec4(lowest, 0.0, 0.0, 0.0);
}
