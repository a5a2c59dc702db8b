// Shading by punctual lights: those left by the pixel's tile and depth bin. CPU reference: cpu_reference/lights.rs.

@group(0) @binding(8) var<storage, read> punctual_light_masks: array<u32>; // of a tile one after the other
@group(0) @binding(9) var<storage, read> punctual_light_bins: array<u32>; // first and, shifted by 16, last punctual light of a range of depths

// Punctual lights that may reach a depth: first and last.
fn punctual_lights_at(depth: f32) -> vec2<u32> {
    if (punctual_lights.clusters == 0u) {
        return vec2(0u, punctual_lights.count - 1u);
    }
    let bin = u32(clamp(log2(max(depth / punctual_lights.nearest, 1.0)) * punctual_lights.bins_per_octave, 0.0, f32(punctual_lights.bins - 1u)));
    let packed = punctual_light_bins[bin];
    return vec2(packed & 0xffffu, packed >> 16u);
}

// Irradiance over pi on what faces a punctual light, at a place relative to it (KHR_lights_punctual).
fn from_punctual_light(punctual_light: PunctualLight, away: vec3<f32>, squared: f32) -> vec3<f32> {
    let near = squared / (punctual_light.range * punctual_light.range);
    let window = clamp(1.0 - near * near, 0.0, 1.0);
    let cone = clamp(dot(away * inverseSqrt(squared), punctual_light.direction) * punctual_light.spot_scale + punctual_light.spot_offset, 0.0, 1.0);
    return punctual_light.colour * (window * cone * cone / squared);
}

fn mask_of(pixel: vec2<u32>) -> u32 {
    let tile = pixel / punctual_lights.tile_px;
    return (tile.y * punctual_lights.tiles_across + tile.x) * punctual_lights.words;
}

// Radiance that a surface at a place and depth sends towards the eye from all punctual lights.
fn from_punctual_lights(r: Reflector, position: vec3<f32>, pixel: vec2<u32>, depth: f32) -> vec3<f32> {
    let reach = punctual_lights_at(depth);
    if (punctual_lights.count == 0u || reach.x > reach.y) {
        return vec3(0.0);
    }
    let mask = mask_of(pixel);
    var sum = vec3(0.0);
    for (var word = reach.x / 32u; word <= reach.y / 32u; word++) {
        var bits = punctual_light_masks[mask + word];
        while (bits != 0u) {
            let bit = firstTrailingBit(bits);
            bits &= bits - 1u;
            let punctual_light = punctual_light_list[word * 32u + bit];
            let away = position - punctual_light.position;
            // What is nearer than a thousandth of its range sees no more than from there.
            let squared = max(dot(away, away), 1e-6 * punctual_light.range * punctual_light.range);
            if (squared < punctual_light.range * punctual_light.range) {
                sum += from_light(r, -away * inverseSqrt(squared), from_punctual_light(punctual_light, away, squared));
            }
        }
    }
    return sum;
}

// How many punctual lights a pixel's tile and depth leave.
fn punctual_lights_left(pixel: vec2<u32>, depth: f32) -> u32 {
    let reach = punctual_lights_at(depth);
    let mask = mask_of(pixel);
    var left = 0u;
    for (var word = reach.x / 32u; word <= reach.y / 32u && reach.x <= reach.y; word++) {
        var bits = punctual_light_masks[mask + word];
        if (word == reach.x / 32u) {
            bits &= 0xffffffffu << (reach.x % 32u);
        }
        if (word == reach.y / 32u) {
            bits &= 0xffffffffu >> (31u - reach.y % 32u);
        }
        left += countOneBits(bits);
    }
    return left;
}
