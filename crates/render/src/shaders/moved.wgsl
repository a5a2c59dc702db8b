// Motion of moving objects: previous positions of vertices and instances.

struct Moved {
    // As in the G-buffer, whose depths it meets.
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) before: vec3<f32>, // world axes, relative to this frame's eye
}

@fragment
fn fs_motion(m: Moved) -> @location(0) vec4<f32> {
    let motion = place_before(vec4(m.before, 1.0)) - place_now(vec2<i32>(m.clip.xy));
    return vec4(clamp(motion, vec2(-0.5 * STANDS), vec2(0.5 * STANDS)), 0.0, 0.0);
}
