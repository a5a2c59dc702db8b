// Punctual lights, added to the lit picture.

@group(0) @binding(1) var depth_map: texture_2d<f32>;
@group(0) @binding(2) var surface_normals: texture_2d<f32>;
@group(0) @binding(3) var albedo_map: texture_2d<f32>;

@fragment
fn fs_punctual_lights(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    let depth = depth_of(pixel);
    let stored = textureLoad(surface_normals, pixel, 0);
    if (depth >= FAR || is_unlit(stored)) {
        discard;
    }
    let albedo = textureLoad(albedo_map, pixel, 0);
    let ray = view_ray(pixel);
    let position = (transpose(frame.view_from_world) * vec4(ray * depth, 0.0)).xyz;
    let distance = depth * length(ray);
    let normal = from_octahedral(stored.xy);
    let r = Reflector(albedo.rgb, albedo.a, stored.z, normal, -position / distance, 1.0, specular_at(pixel, normal));
    // Only the extinction by haze: its in-scattered light was added before.
    let left = exp(-min(max(frame.sky_side.w, 0.0) * distance, 80.0));
    return vec4(min(from_punctual_lights(r, position, vec2<u32>(pixel), depth) * left, vec3(MAX_RADIANCE)), 0.0);
}

// Debug view: number of lights evaluated per pixel: black for none, then blue over green and yellow to red for 64.
@fragment
fn fs_punctual_lights_left(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    let depth = depth_of(pixel);
    if (depth >= FAR) {
        return vec4(0.0);
    }
    let left = f32(punctual_lights_left(vec2<u32>(pixel), depth));
    let heat = clamp(log2(1.0 + left) / 6.0, 0.0, 1.0) * 4.0;
    let colour = clamp(vec3(heat - 2.0, min(heat, 4.0 - heat), 2.0 - heat), vec3(0.0), vec3(1.0));
    return vec4(select(colour, vec3(0.0), left < 0.5), 1.0);
}

fn depth_of(pixel: vec2<i32>) -> f32 {
    return view_depth(textureLoad(depth_map, pixel, 0).x);
}
