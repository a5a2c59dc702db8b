// Depth of caps. The G-buffer has that of the back faces behind them, by which they were found: of a closed mesh the eye
// sees a back face only through the cut. Their depth becomes the plane's, once nothing is tested against the faces' any more.

@group(0) @binding(1) var normal_map: texture_2d<f32>;

@fragment
fn fs_caps(@builtin(position) at: vec4<f32>) -> @builtin(frag_depth) f32 {
    let pixel = vec2<i32>(at.xy);
    if (!is_cap(textureLoad(normal_map, pixel, 0))) {
        discard;
    }
    // Of unit depth.
    let ray = (transpose(frame.view_from_world) * vec4(view_ray(pixel), 0.0)).xyz;
    let entry = section_entry(ray);
    return clamp(frame.near / max(entry.at, frame.near), 0.0, 1.0);
}
