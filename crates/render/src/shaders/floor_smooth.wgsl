// Mean over the pattern of the picture of a studio's ground: a texel's stands for its upper left corner.

@group(0) @binding(0) var patterned: texture_2d<f32>;

@fragment
fn fs_smooth(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let last = vec2<i32>(textureDimensions(patterned)) - 1;
    var sum = vec2(0.0);
    for (var y = -2; y < 2; y++) {
        for (var x = -2; x < 2; x++) {
            sum += textureLoad(patterned, clamp(vec2<i32>(at.xy) + vec2(x, y), vec2(0), last), 0).xy;
        }
    }
    return vec4(sum / 16.0, 0.0, 1.0);
}
