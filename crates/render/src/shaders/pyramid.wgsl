// A level of the depth pyramid: the nearest of four depths, which is the greatest stored value.

@group(0) @binding(1) var finer: texture_2d<f32>;

@fragment
fn fs_pyramid(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let first = 2 * vec2<i32>(at.xy);
    let size = vec2<i32>(textureDimensions(finer));
    var nearest = 0.0;
    for (var i = 0; i < 4; i++) {
        let texel = first + vec2(i & 1, i >> 1u);
        // Outside the picture there is no surface.
        if (all(texel < size)) {
            nearest = max(nearest, textureLoad(finer, texel, 0).x);
        }
    }
    return vec4(nearest, 0.0, 0.0, 0.0);
}
