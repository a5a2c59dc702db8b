// Counts a drawn fragment.

@fragment
fn fs_overdraw() -> @location(0) vec4<f32> {
    return vec4(1.0, 0.0, 0.0, 0.0);
}
