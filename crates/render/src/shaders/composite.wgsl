// Composes the finished picture into a host's targets: colour as in tonemap.wgsl, and depth.

@group(0) @binding(2) var depth_map: texture_depth_2d;

// Whether what the host drew stays where none of our surfaces is.
override KEEP: bool = false;

struct Composite {
    @location(0) colour: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

// For targets with depth: the depth test keeps the host's nearer surfaces.
@fragment
fn fs_composite(@builtin(position) at: vec4<f32>) -> Composite {
    let depth = textureLoad(depth_map, vec2<i32>(at.xy), 0);
    if (KEEP && depth <= 0.0) {
        discard;
    }
    return Composite(display(at.xy), depth);
}

// For targets without.
@fragment
fn fs_overlay(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    if (textureLoad(depth_map, vec2<i32>(at.xy), 0) <= 0.0) {
        discard;
    }
    return display(at.xy);
}
