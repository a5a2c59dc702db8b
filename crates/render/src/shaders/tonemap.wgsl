// Linear radiance to display values. CPU reference: cpu_reference/tone.rs.

// Whether the target stores what it is given, so that the sRGB curve is applied here; a target with
// an sRGB format applies it by itself.
override ENCODE_SRGB: bool = false;

// Whether what is shown is a mean of frames (temporal.wgsl): weighed, and by exposure already.
override TEMPORAL: bool = false;

// Whether each pixel of what is drawn into is one of the radiance's, however large the target is.
override AS_IT_IS: bool = false;

@group(0) @binding(1) var radiance_map: texture_2d<f32>;

// The neutral curve (Khronos, "PBR neutral tone mapper", 2024): base colours below 0.8 stay what they are but for the four
// hundredths that a dielectric mirrors; what is brighter is compressed and loses its hue towards white.
fn neutral(given: vec3<f32>) -> vec3<f32> {
    let start = 0.8 - 0.04;
    let least = min(given.r, min(given.g, given.b));
    let offset = select(0.04, least - 6.25 * least * least, least < 0.08);
    let colour = given - offset;
    let peak = max(colour.r, max(colour.g, colour.b));
    if (peak < start) {
        return colour;
    }
    let room = 1.0 - start;
    let compressed = 1.0 - room * room / (peak + room - start);
    let white = 1.0 - 1.0 / (0.15 * (peak - compressed) + 1.0);
    return mix(colour * (compressed / peak), vec3(compressed), white);
}

// Noise from -0.5 to 0.5 that is even over any 3 × 3 pixels (Jimenez, "Next generation post processing in Call of Duty",
// 2014).
fn noise(at: vec2<f32>) -> f32 {
    return fract(52.9829189 * fract(dot(floor(at), vec2(0.06711056, 0.00583715)))) - 0.5;
}

// Fit of the ACES filmic curve (Narkowicz, "ACES filmic tone mapping curve", 2016).
fn filmic(x: vec3<f32>) -> vec3<f32> {
    return clamp((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), vec3(0.0), vec3(1.0));
}

// IEC 61966-2-1.
fn encode_srgb(x: vec3<f32>) -> vec3<f32> {
    return select(1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, 12.92 * x, x <= vec3(0.0031308));
}

fn radiance_of(texel: vec2<i32>) -> vec3<f32> {
    return textureLoad(radiance_map, texel, 0).rgb;
}

// The radiance at a point of the target, in its pixels: of the pixel where both have one size, else between the nearest
// four.
fn radiance_at(at: vec2<f32>) -> vec3<f32> {
    let size = vec2<f32>(textureDimensions(radiance_map));
    if (AS_IT_IS || all(size == shown_size())) {
        return radiance_of(vec2<i32>(at));
    }
    let t = between(at, size);
    let above = mix(radiance_of(t.a), radiance_of(vec2(t.b.x, t.a.y)), t.part.x);
    let below = mix(radiance_of(vec2(t.a.x, t.b.y)), radiance_of(t.b), t.part.x);
    return mix(above, below, t.part.y);
}

// What a point of the target shows.
fn display(at: vec2<f32>) -> vec4<f32> {
    var given = vec3(0.0);
    if (TEMPORAL) {
        let weighed = min(radiance_at(at), vec3(0.9999));
        given = weighed / (1.0 - max(weighed.r, max(weighed.g, weighed.b)));
    } else {
        given = clamp(radiance_at(at) * frame.exposure, vec3(0.0), vec3(MAX_RADIANCE));
    }
    var shown = vec3(0.0);
    if (frame.tone_mapping == 1u) {
        shown = neutral(given);
    } else {
        shown = filmic(given);
    }
    // Against banding: as much noise as the target's 256 steps are wide.
    let encoded = clamp(encode_srgb(shown) + noise(at) * frame.dither, vec3(0.0), vec3(1.0));
    if (ENCODE_SRGB) {
        return vec4(encoded, 1.0);
    }
    return vec4(linear_from_srgb(encoded), 1.0);
}

@fragment
fn fs_tonemap(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return display(at.xy);
}
