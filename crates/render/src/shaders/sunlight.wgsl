// Share of the sun's light per pixel.

@group(0) @binding(5) var surface_normals: texture_2d<f32>;

@fragment
fn fs_sunlight(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    let depth = depth_at(pixel);
    if (depth >= FAR) {
        return vec4(1.0, 1.0, 0.0, 0.0);
    }
    let centre = view_ray(pixel) * depth;
    let world_from_view = transpose(frame.view_from_world);
    var normal = (world_from_view * vec4(normal_at(pixel, centre), 0.0)).xyz;
    let position = (world_from_view * vec4(centre, 0.0)).xyz;
    var cosine = dot(normal, frame.to_sun.xyz);
    if (cosine <= 0.0) {
        // Shading normals decide: a facet may face away from the sun where the smooth surface does not, and depth
        // differences across edges are meaningless.
        normal = from_octahedral(textureLoad(surface_normals, pixel, 0).xy);
        cosine = dot(normal, frame.to_sun.xyz);
        if (cosine <= 0.0) {
            return vec4(0.0, 1.0, 0.0, 0.0);
        }
    }
    return vec4(sunlight_at(position, normal, cosine), 0.0, 0.0);
}
