// Depth lookups of occlusion estimators in the whole picture.

// Offset in pixels for a share of the radius, at least one pixel: the receiver's own pixel occludes nothing.
fn march_px(r: Receiver, share: f32) -> f32 {
    return mix(1.0, max(r.radius * frame.scale_px / r.depth, 1.0), share);
}

// Surface at an offset in pixels, relative to the receiver in view space; 0 outside the picture, at the receiver's
// pixel and in the sky.
fn drawn_at(r: Receiver, offset_px: vec2<f32>) -> vec3<f32> {
    let there = vec2<i32>(floor(vec2<f32>(r.pixel) + 0.5 + offset_px));
    if (any(there < vec2(0)) || any(there >= vec2<i32>(frame.size_px)) || all(there == r.pixel)) {
        return vec3(0.0);
    }
    let depth = depth_at(there);
    return select(view_ray(there) * depth - r.centre, vec3(0.0), depth >= FAR);
}

@fragment
fn fs_occlusion(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    return vec4(open_at(pixel, pixel));
}

// Of one pixel of each 2x2.
@fragment
fn fs_occlusion_half(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let cell = vec2<i32>(at.xy);
    return vec4(open_at(half_pixel(cell), cell));
}
