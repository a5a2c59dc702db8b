// Ambient occlusion by points in the hemisphere above the surface, rotated per pixel in a 4x4 pattern (after Mittring,
// "Finding next gen: CryEngine 2", 2007, with the normal-oriented hemisphere of Filion and McNaughton, "StarCraft II
// effects and techniques", 2008). CPU reference: cpu_reference/occlusion/ssao.rs.

fn occlusion_sums(r: Receiver) -> vec2<f32> {
    let frame_of = basis(r.normal);
    let angle = f32(r.rotation) * (2.0 * PI / 16.0);
    let turn = vec2(cos(angle), sin(angle));

    var occluded = 0.0;
    for (var i = 0u; i < frame.occlusion_samples; i++) {
        let k = frame.kernel[i].xyz;
        let turned = vec3(k.x * turn.x - k.y * turn.y, k.x * turn.y + k.y * turn.x, k.z);
        let sample = r.centre + frame_of * turned * r.radius;
        if (sample.z >= 0.0) {
            continue; // behind the eye
        }
        let ndc = sample.xy / (frame.tan_half_fov * -sample.z);
        if (any(abs(ndc) >= vec2(1.0))) {
            continue; // outside the picture: nothing known
        }
        let uv = vec2(ndc.x * 0.5 + 0.5, 0.5 - ndc.y * 0.5);
        let there = vec2<i32>(uv * frame.size_px - frame.jitter);
        let depth_there = depth_at(there);
        let surface = view_ray(there) * depth_there;
        let hides = depth_there < -sample.z && dot(surface - r.centre, r.normal) > MIN_ELEVATION * r.radius;
        if (hides) {
            // Things far in front of the surface do not shade it. A point counts for what it stands for.
            let near = smoothstep(0.0, 1.0, r.radius / max(abs(r.depth - depth_there), 1e-30));
            occluded += near * frame.kernel[i].w;
        }
    }
    return vec2(occluded, f32(frame.occlusion_samples));
}
