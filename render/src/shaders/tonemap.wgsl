// Linear radiance to display values. Twin: twin/tone.rs.

// Whether the target stores what it is given, so that the sRGB curve is applied here; a target with
// an sRGB format applies it by itself.
override ENCODE_SRGB: bool = false;

@group(0) @binding(1) var radiance_map: texture_2d<f32>;

// Fit of the ACES filmic curve (Narkowicz, "ACES filmic tone mapping curve", 2016).
fn filmic(x: vec3<f32>) -> vec3<f32> {
    return clamp((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), vec3(0.0), vec3(1.0));
}

// IEC 61966-2-1.
fn encode_srgb(x: vec3<f32>) -> vec3<f32> {
    return select(1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, 12.92 * x, x <= vec3(0.0031308));
}

// What a pixel shows.
fn display(pixel: vec2<i32>) -> vec4<f32> {
    let radiance = textureLoad(radiance_map, pixel, 0).rgb;
    let shown = filmic(max(radiance * frame.exposure, vec3(0.0)));
    if (ENCODE_SRGB) {
        return vec4(encode_srgb(shown), 1.0);
    }
    return vec4(shown, 1.0);
}

@fragment
fn fs_tonemap(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return display(vec2<i32>(at.xy));
}
