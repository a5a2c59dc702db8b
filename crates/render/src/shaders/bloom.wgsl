// Bloom: downsampling and upsampling. CPU reference: cpu_reference/bloom.rs.

@group(0) @binding(1) var source: texture_2d<f32>;
@group(0) @binding(2) var source_sampler: sampler;

// A lookup so many texels off a place of the picture, 0 to 1 along its sides.
fn tap(place: vec2<f32>, x: f32, y: f32) -> vec3<f32> {
    let texel = 1.0 / vec2<f32>(textureDimensions(source));
    return textureSampleLevel(source, source_sampler, place + vec2(x, y) * texel, 0.0).rgb;
}

// Thirteen lookups as five overlapping boxes of four, the middle one for half (Jimenez, "Next generation post processing in
// Call of Duty", 2014).
fn halved(at: vec2<f32>) -> vec3<f32> {
    let box = tap(at, -1.0, -1.0) + tap(at, 1.0, -1.0) + tap(at, -1.0, 1.0) + tap(at, 1.0, 1.0);
    let sides = tap(at, 0.0, -2.0) + tap(at, -2.0, 0.0) + tap(at, 2.0, 0.0) + tap(at, 0.0, 2.0);
    let corners = tap(at, -2.0, -2.0) + tap(at, 2.0, -2.0) + tap(at, -2.0, 2.0) + tap(at, 2.0, 2.0);
    return 0.125 * box + 0.0625 * sides + 0.03125 * corners + 0.125 * tap(at, 0.0, 0.0);
}

// A tent over three by three texels.
fn tent(at: vec2<f32>) -> vec3<f32> {
    let sides = tap(at, 0.0, -1.0) + tap(at, -1.0, 0.0) + tap(at, 1.0, 0.0) + tap(at, 0.0, 1.0);
    let corners = tap(at, -1.0, -1.0) + tap(at, 1.0, -1.0) + tap(at, -1.0, 1.0) + tap(at, 1.0, 1.0);
    return (4.0 * tap(at, 0.0, 0.0) + 2.0 * sides + corners) / 16.0;
}

struct At {
    @builtin(position) position: vec4<f32>,
    @location(0) place: vec2<f32>,
}

// One triangle that covers the picture, with places of it.
@vertex
fn vs_bloom(@builtin(vertex_index) i: u32) -> At {
    let place = vec2(f32((i << 1u) & 2u), f32(i & 2u));
    return At(vec4(place.x * 2.0 - 1.0, 1.0 - place.y * 2.0, 0.0, 1.0), place);
}

@fragment
fn fs_halved(at: At) -> @location(0) vec4<f32> {
    return vec4(halved(at.place), 1.0);
}

@fragment
fn fs_tent(at: At) -> @location(0) vec4<f32> {
    return vec4(tent(at.place), 1.0);
}
