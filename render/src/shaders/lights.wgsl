// Light of lamps on a surface: those that its pixel's tile and its depth leave. Twin: twin/lights.rs.

@group(0) @binding(8) var<storage, read> lamp_masks: array<u32>; // of a tile one after the other
@group(0) @binding(9) var<storage, read> lamp_bins: array<u32>; // first and, shifted by 16, last lamp of a range of depths

// Lamps that may reach a depth: first and last.
fn lamps_at(depth: f32) -> vec2<u32> {
    if (lamps.clusters == 0u) {
        return vec2(0u, lamps.count - 1u);
    }
    let bin = u32(clamp(log2(max(depth / lamps.nearest, 1.0)) * lamps.bins_per_octave, 0.0, f32(lamps.bins - 1u)));
    let packed = lamp_bins[bin];
    return vec2(packed & 0xffffu, packed >> 16u);
}

// Irradiance over pi on what faces a lamp, at a place relative to it (KHR_lights_punctual).
fn from_lamp(lamp: Lamp, away: vec3<f32>, squared: f32) -> vec3<f32> {
    let near = squared / (lamp.range * lamp.range);
    let window = clamp(1.0 - near * near, 0.0, 1.0);
    let cone = clamp(dot(away * inverseSqrt(squared), lamp.direction) * lamp.spot_scale + lamp.spot_offset, 0.0, 1.0);
    return lamp.colour * (window * cone * cone / squared);
}

fn mask_of(pixel: vec2<u32>) -> u32 {
    let tile = pixel / lamps.tile_px;
    return (tile.y * lamps.tiles_across + tile.x) * lamps.words;
}

// Radiance that a surface at a place and depth sends towards the eye from all lamps.
fn from_lamps(r: Reflector, position: vec3<f32>, pixel: vec2<u32>, depth: f32) -> vec3<f32> {
    let reach = lamps_at(depth);
    if (lamps.count == 0u || reach.x > reach.y) {
        return vec3(0.0);
    }
    let mask = mask_of(pixel);
    var sum = vec3(0.0);
    for (var word = reach.x / 32u; word <= reach.y / 32u; word++) {
        var bits = lamp_masks[mask + word];
        while (bits != 0u) {
            let bit = firstTrailingBit(bits);
            bits &= bits - 1u;
            let lamp = lamp_list[word * 32u + bit];
            let away = position - lamp.position;
            // What is nearer than a thousandth of its range sees no more than from there.
            let squared = max(dot(away, away), 1e-6 * lamp.range * lamp.range);
            if (squared < lamp.range * lamp.range) {
                sum += from_light(r, -away * inverseSqrt(squared), from_lamp(lamp, away, squared));
            }
        }
    }
    return sum;
}

// How many lamps a pixel's tile and depth leave.
fn lamps_left(pixel: vec2<u32>, depth: f32) -> u32 {
    let reach = lamps_at(depth);
    let mask = mask_of(pixel);
    var left = 0u;
    for (var word = reach.x / 32u; word <= reach.y / 32u && reach.x <= reach.y; word++) {
        var bits = lamp_masks[mask + word];
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
