// Quantised light with noisy borders under blurred strokes. CPU reference: cpu_reference/ink.rs.

@group(0) @binding(1) var lit_map: texture_2d<f32>;
@group(0) @binding(2) var depth_map: texture_2d<f32>;
@group(0) @binding(3) var albedo_map: texture_2d<f32>;
@group(0) @binding(4) var strokes_map: texture_2d<f32>;
@group(0) @binding(5) var<uniform> ink: Ink;

// Pixels that a cell of noise is wide, up to twice.
const CELL_PX: f32 = 2.0;
// The eye's cells of size 1.
const OCTAVE_0: f32 = 32.0;
// Least albedo that light is reckoned by.
const LEAST_ALBEDO: f32 = 1.0 / 64.0;

// BT.709.
fn luminance(c: vec3<f32>) -> f32 {
    return dot(c, vec3(0.2126, 0.7152, 0.0722));
}

// Rows of Pascal's triangle, which approach a Gaussian: of 1, 3, 5 or 7 pixels.
fn weight(from_middle: i32) -> f32 {
    let at = abs(from_middle);
    switch ink.blur {
        case 0: { return 1.0; }
        case 1: { return select(0.25, 0.5, at == 0); }
        case 2: { return select(select(0.0625, 0.25, at == 1), 0.375, at == 0); }
        default: {
            return select(select(select(0.015625, 0.09375, at == 2), 0.234375, at == 1), 0.3125, at == 0);
        }
    }
}

fn blurred(pixel: vec2<i32>) -> f32 {
    let last = vec2<i32>(frame.size_px) - 1;
    var sum = 0.0;
    for (var y = -ink.blur; y <= ink.blur; y++) {
        for (var x = -ink.blur; x <= ink.blur; x++) {
            let at = clamp(pixel + vec2(x, y), vec2(0), last);
            sum += weight(x) * weight(y) * textureLoad(strokes_map, at, 0).x;
        }
    }
    return sum;
}

// The finaliser of MurmurHash3 (Appleby 2011).
fn scrambled(word: u32) -> u32 {
    var x = word;
    x = (x ^ (x >> 16u)) * 0x85ebca6bu;
    x = (x ^ (x >> 13u)) * 0xc2b2ae35u;
    return x ^ (x >> 16u);
}

// Of a corner of the cells, 0 to 1.
fn value(octave: i32, corner: vec3<i32>) -> f32 {
    let c = vec3<u32>(corner & vec3(255));
    return f32(scrambled(c.x | (c.y << 8u) | (c.z << 16u) | (u32(octave) << 24u)) >> 8u) / 16777216.0;
}

// Value noise in cells of 2^(octave - 32) world units, at a place relative to the eye (Perlin and Hoffert, "Hypertexture",
// 1989).
fn noise_in(octave: i32, place: vec3<f32>) -> f32 {
    let at = ink.eye[octave].xyz + place * exp2(OCTAVE_0 - f32(octave));
    let low = floor(at);
    let way = at - low;
    let t = way * way * (3.0 - 2.0 * way);
    let c = vec3<i32>(low);
    let near = mix(
        mix(value(octave, c), value(octave, c + vec3(1, 0, 0)), t.x),
        mix(value(octave, c + vec3(0, 1, 0)), value(octave, c + vec3(1, 1, 0)), t.x), t.y);
    let far = mix(
        mix(value(octave, c + vec3(0, 0, 1)), value(octave, c + vec3(1, 0, 1)), t.x),
        mix(value(octave, c + vec3(0, 1, 1)), value(octave, c + vec3(1, 1, 1)), t.x), t.y);
    return mix(near, far, t.z);
}

// Noise that stays on surfaces that stand, in cells about as large as CELL_PX wherever they are: between two octaves.
fn noise(place: vec3<f32>, depth: f32) -> f32 {
    let wanted = clamp(log2(CELL_PX * depth / frame.scale_px) + OCTAVE_0, 0.0, 62.0);
    let octave = floor(wanted);
    return mix(noise_in(i32(octave), place), noise_in(i32(octave) + 1, place), wanted - octave);
}

// What light becomes: the middle of its level. Levels are even of l / (1 + l), which has room for any light, and borders
// between them are moved by as much of a level as noise says.
fn level_of(light: f32, noise: f32) -> f32 {
    let share = light / (1.0 + light);
    let level = floor(share * ink.levels + (noise - 0.5) * ink.spatter);
    let middle = (clamp(level, 0.0, ink.levels - 1.0) + 0.5) / ink.levels;
    return middle / (1.0 - middle);
}

@fragment
fn fs_ink(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    let lit = textureLoad(lit_map, pixel, 0);
    let stored = textureLoad(depth_map, pixel, 0).x;
    var radiance = lit.rgb;
    if (ink.levels > 0.0 && stored > 0.0) {
        let depth = view_depth(stored);
        let place = (transpose(frame.view_from_world) * vec4(view_ray(pixel) * depth, 0.0)).xyz;
        let albedo = max(luminance(textureLoad(albedo_map, pixel, 0).rgb), LEAST_ALBEDO);
        let light = clamp(luminance(radiance) / albedo * frame.exposure, 0.0, MAX_RADIANCE);
        let drawn = level_of(light, noise(place, depth));
        // What is black has no colour to be lit.
        radiance *= drawn / max(light, 1e-4);
    }
    radiance *= 1.0 - blurred(pixel);
    return vec4(clamp(radiance, vec3(0.0), vec3(MAX_RADIANCE)), lit.a);
}
