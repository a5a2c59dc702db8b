// Upscaling of the finished picture, bilinear. CPU reference: cpu_reference/antialias.rs.

// Whether the target applies the sRGB curve, so that it takes linear values.
override DECODE_SRGB: bool = false;

@group(0) @binding(1) var display_map: texture_2d<f32>;
@group(0) @binding(2) var between_texels: sampler;

@fragment
fn fs_enlarge(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let shown_size = vec2(f32(frame.target_px & 0xffffu), f32(frame.target_px >> 16u));
    let colour = textureSampleLevel(display_map, between_texels, at.xy / shown_size, 0.0).rgb;
    if (DECODE_SRGB) {
        return vec4(linear_from_srgb(colour), 1.0);
    }
    return vec4(colour, 1.0);
}
