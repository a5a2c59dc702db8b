// GTAO (Jimenez et al. 2016), with the falloff applied to each rise of the horizon. The paper applies one falloff to
// the highest horizon, which ignores what lies below it. CPU reference: cpu_reference/occlusion/gtao.rs.

fn occlusion_sums(r: Receiver) -> vec2<f32> {
    let steps = step_count();
    var sums = vec2(0.0);
    for (var i = 0u; i < slice_count(); i++) {
        let slice = slice_of(r, i);
        var occluded = 0.0;
        var whole = 0.0;
        for (var side = -1.0; side < 2.0; side += 2.0) {
            var horizon = -side * slice.sine;
            var open = arc(slice, slice.angle + side * (0.5 * PI));
            whole += open;
            var last = vec3(0.0);
            for (var k = 0u; k < steps; k++) {
                let to = drawn_at(r, slice.offset_px * (side * step_length(r, k)));
                let at = within(r, slice, to);
                let distance = length(at);
                let cosine = (at.y * slice.cosine - at.x * slice.sine) / max(distance, 1e-30);
                let met = met_between(r, last, to);
                last = to;
                if (at.y > MIN_ELEVATION * distance && cosine > horizon) {
                    let left = arc(slice, side * acos(clamp(cosine, -1.0, 1.0)));
                    occluded += met * (open - left);
                    horizon = cosine;
                    open = left;
                }
            }
        }
        sums += slice.normal_length * vec2(occluded, whole);
    }
    return vec2(max(sums.x, 0.0), max(sums.y, 1e-6));
}
