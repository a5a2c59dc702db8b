// Motion vectors of mesh vertices.

@vertex
fn vs_motion(
    v: VertexIn, @location(9) offset_scale_before: vec4<f32>, @location(10) rotation_before: vec4<f32>,
    @location(12) states_before: u32,
) -> Moved {
    let unmoved = mix(v.morph_from, v.position, morph_weight(frame.before_s - v.birth_s));
    let local = part_moved(posed(unmoved, v, states_before), part_move(v, states_before));
    return Moved(shown(placed(v), part_state(v)), in_world(local, offset_scale_before, rotation_before));
}
