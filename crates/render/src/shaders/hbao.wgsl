// Horizon-based ambient occlusion (Bavoil, Sainz and Dimitrov, "Image-space horizon-based ambient occlusion", 2008):
// along directions of the picture, how high above the tangent plane what is drawn rises. Each rise over the horizon so far
// counts with the falloff of where it is met. Elevations are those above the tangent plane, and their sines squared: the
// integral of directions weighted by the cosine, where the paper's sines weight all alike. CPU reference: cpu_reference/occlusion/hbao.rs.

fn occlusion_sums(r: Receiver) -> vec2<f32> {
    let samples = frame.occlusion_samples;
    let steps = clamp(samples / 4u, 1u, 4u);
    let directions = max(samples / steps, 1u);
    var occluded = 0.0;
    for (var i = 0u; i < directions; i++) {
        let angle = 2.0 * PI * (f32(i) + f32(r.rotation) / 16.0) / f32(directions);
        let along = vec2(cos(angle), sin(angle));
        var horizon = MIN_ELEVATION * MIN_ELEVATION;
        var last = vec3(0.0);
        for (var k = 0u; k < steps; k++) {
            let share = (f32(k) + march_offset(r)) / f32(steps);
            let to = drawn_at(r, along * march_px(r, share));
            let height = dot(to, r.normal);
            let squared = dot(to, to);
            let rise = height * height / max(squared, 1e-30);
            let met = met_between(r, last, to);
            last = to;
            if (height > 0.0 && rise > horizon) {
                occluded += met * (rise - horizon);
                horizon = rise;
            }
        }
    }
    return vec2(occluded, f32(directions));
}
