// The punctual lights of a frame.

struct PunctualLight {
    position: vec3<f32>, // relative to the eye
    range: f32, // beyond which it lights nothing
    colour: vec3<f32>, // intensity over pi
    spot_scale: f32,
    direction: vec3<f32>,
    spot_offset: f32,
}

struct PunctualLights {
    count: u32,
    words: u32, // of a tile's mask
    tile_px: u32,
    tiles_across: u32,
    nearest: f32, // depth at which the first bin begins
    bins_per_octave: f32,
    clusters: u32,
    bins: u32,
    through: u32, // something in the picture is seen through
}

@group(0) @binding(6) var<uniform> punctual_lights: PunctualLights;
@group(0) @binding(7) var<storage, read> punctual_light_list: array<PunctualLight>; // from near to far
