// Upscaling of the finished picture. CPU reference: cpu_reference/antialias.rs.

// Whether the target applies the sRGB curve, so that it takes linear values.
override DECODE_SRGB: bool = false;

@group(0) @binding(1) var display_map: texture_2d<f32>;

fn shown(texel: vec2<i32>) -> vec3<f32> {
    return textureLoad(display_map, texel, 0).rgb;
}

@fragment
fn fs_enlarge(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let t = between(at.xy, vec2<f32>(textureDimensions(display_map)));
    let above = mix(shown(t.a), shown(vec2(t.b.x, t.a.y)), t.part.x);
    let below = mix(shown(vec2(t.a.x, t.b.y)), shown(t.b), t.part.x);
    let colour = mix(above, below, t.part.y);
    if (DECODE_SRGB) {
        return vec4(linear_from_srgb(colour), 1.0);
    }
    return vec4(colour, 1.0);
}
