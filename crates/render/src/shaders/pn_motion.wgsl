// Motion vectors of PN triangles.

@group(3) @binding(5) var<storage, read> instances_before: array<vec4<f32>>;

@vertex
fn vs_motion(v: VertexIn) -> Moved {
    let at = patch_point(v);
    let local = local_at(v, at, frame.before_s);
    let before = in_world(local, instances_before[INSTANCE_VECTORS * at.instance], instances_before[INSTANCE_VECTORS * at.instance + 1u]);
    return Moved(clip_position(placed(v, at)), before);
}
