// Light of lamps, onto the lit picture: those that a pixel's tile and depth leave. Twin: twin/lights.rs.

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

@group(0) @binding(1) var depth_map: texture_2d<f32>;
@group(0) @binding(2) var surface_normals: texture_2d<f32>;
@group(0) @binding(3) var albedo_map: texture_2d<f32>;

@fragment
fn fs_lamps(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    let depth = depth_of(pixel);
    let stored = textureLoad(surface_normals, pixel, 0);
    if (depth >= FAR || is_unlit(stored)) {
        discard;
    }
    let albedo = textureLoad(albedo_map, pixel, 0);
    let ray = view_ray(pixel);
    let position = (transpose(frame.view_from_world) * vec4(ray * depth, 0.0)).xyz;
    let distance = depth * length(ray);
    let r = Reflector(albedo.rgb, albedo.a, stored.z, from_octahedral(stored.xy), -position / distance, 1.0);
    // Haze takes its share; what it adds is there already.
    let left = exp(-min(max(frame.sky_side.w, 0.0) * distance, 80.0));
    return vec4(min(from_lamps(r, position, vec2<u32>(pixel), depth) * left, vec3(MAX_RADIANCE)), 0.0);
}

// How many lamps are looked at, in place of the picture: black for none, then blue over green and yellow to red for 64.
@fragment
fn fs_lamps_left(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    let depth = depth_of(pixel);
    if (depth >= FAR) {
        return vec4(0.0);
    }
    let left = f32(lamps_left(vec2<u32>(pixel), depth));
    let heat = clamp(log2(1.0 + left) / 6.0, 0.0, 1.0) * 4.0;
    let colour = clamp(vec3(heat - 2.0, min(heat, 4.0 - heat), 2.0 - heat), vec3(0.0), vec3(1.0));
    return vec4(select(colour, vec3(0.0), left < 0.5), 1.0);
}

fn depth_of(pixel: vec2<i32>) -> f32 {
    return view_depth(textureLoad(depth_map, pixel, 0).x);
}
