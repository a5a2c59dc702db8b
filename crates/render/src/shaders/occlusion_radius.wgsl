// Radius of occlusion at a depth. CPU reference: cpu_reference/occlusion/mod.rs.

// Below this radius in pixels there is nothing to see.
const MIN_RADIUS_PX: f32 = 1.0;
// Above it the samples are too scattered to make sense.
const MAX_RADIUS_PX: f32 = 256.0;

fn radius_at(depth: f32) -> f32 {
    let wanted = frame.occlusion_radius_world + frame.occlusion_radius_depth * depth;
    return min(wanted, MAX_RADIUS_PX * depth / frame.scale_px);
}
