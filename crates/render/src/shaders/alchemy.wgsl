// Ambient occlusion by points on a spiral (McGuire, Osman, Bukowski and Hennessy, "The Alchemy screen-space ambient
// obscurance algorithm", 2011, with the kernel and the falloff of McGuire, Mara and Luebke, "Scalable ambient obscurance",
// 2012, section 2): how high each lies above the tangent plane, over its squared distance. CPU reference: cpu_reference/occlusion/alchemy.rs.

// Turns of the spiral: the paper's for about 9 samples, which no power of two divides.
const TURNS: f32 = 7.0;
// What sums are scaled with: fitted to rays, as the paper leaves its `intensity` to the eye. A corner of two walls needs 1.3,
// views of the demo 1.4 to 2.5.
const GAIN: f32 = 1.5;

fn occlusion_sums(r: Receiver) -> vec2<f32> {
    let samples = frame.occlusion_samples;
    var occluded = 0.0;
    for (var i = 0u; i < samples; i++) {
        let share = (f32(i) + march_offset(r)) / f32(samples);
        let angle = 2.0 * PI * (share * TURNS + f32(r.rotation) / 16.0);
        let to = drawn_at(r, vec2(cos(angle), sin(angle)) * march_px(r, share));
        // In units of the radius.
        let squared = dot(to, to) / (r.radius * r.radius);
        let height = dot(to, r.normal) / r.radius - MIN_ELEVATION * sqrt(squared);
        let near = max(1.0 - squared, 0.0);
        occluded += near * near * near * max(height, 0.0) / (squared + 0.01);
    }
    return vec2(GAIN * occluded, f32(samples));
}
