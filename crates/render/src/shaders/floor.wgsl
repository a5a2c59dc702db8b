// The ground of a studio, shared by its passes. CPU reference: cpu_reference/floor.rs.

struct Floor {
    // Towards the key light's azimuth, across, down; w: place of the eye along them, from the middle of the objects.
    axes: array<vec4<f32>, 3>,
    key_from_floor: mat4x4<f32>, // from places in these axes to the key light's map
    range: vec4<f32>, // undersides: 1 / side of their map, range of its depths, depth 0 under the middle; key light: range
    picture: vec4<f32>, // of the ground: middle, half the sides
    size: vec4<f32>, // radius of the objects; 1 / side of the key light's map
}

@group(0) @binding(1) var<uniform> studio: Floor;
// Greatest depths of blocks of the map of undersides.
@group(0) @binding(2) var lowest_map: texture_2d<f32>;

struct OnFloor {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) lowest: f32, // depth of the lowest underside, 0 where nothing is
}

// As vs_fullscreen() of fullscreen.wgsl, with the ground's depth.
@vertex
fn vs_floor(@builtin(vertex_index) i: u32) -> OnFloor {
    let size = textureDimensions(lowest_map);
    var lowest = 0.0;
    for (var y = 0u; y < size.y; y++) {
        for (var x = 0u; x < size.x; x++) {
            lowest = max(lowest, textureLoad(lowest_map, vec2(x, y), 0).x);
        }
    }
    let corner = vec2(f32((i << 1u) & 2u), f32(i & 2u));
    return OnFloor(vec4(corner.x * 2.0 - 1.0, 1.0 - corner.y * 2.0, 0.0, 1.0), lowest);
}

// Place of a depth of the map of undersides along the axis down.
fn down_of(depth: f32) -> f32 {
    return depth * studio.range.y - studio.range.z;
}
