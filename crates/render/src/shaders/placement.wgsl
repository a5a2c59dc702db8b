// Placement of mesh vertices.

// Of an `InstanceRaw` as a storage buffer.
const INSTANCE_VECTORS: u32 = 3u;

// Geomorph (Hoppe, "Progressive Meshes", 1996, section 3.2): how far a vertex has come from the
// position it split from.
fn morph_weight(age_s: f32) -> f32 {
    if (frame.morph_s <= 0.0) {
        return 1.0;
    }
    return smoothstep(0.0, 1.0, clamp(age_s, 0.0, frame.morph_s) / frame.morph_s);
}

// A place of an asset, relative to its origin, in an instance of it: world axes, relative to the eye.
fn in_world(local: vec3<f32>, offset_scale: vec4<f32>, rotation: vec4<f32>) -> vec3<f32> {
    return rotate(rotation, local * offset_scale.w) + offset_scale.xyz;
}

fn clip_position(world: vec3<f32>) -> vec4<f32> {
    return frame.clip_from_view * vec4((frame.view_from_world * vec4(world, 0.0)).xyz, 1.0);
}
