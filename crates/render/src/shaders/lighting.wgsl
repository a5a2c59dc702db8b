// Sun and ambient light on the G-buffer, sky where there is no surface.

override OCCLUSION: bool = false;
override SHADOWS: bool = false;

@group(0) @binding(1) var depth_map: texture_2d<f32>;
@group(0) @binding(2) var surface_normals: texture_2d<f32>;
@group(0) @binding(3) var albedo_map: texture_2d<f32>;
@group(0) @binding(4) var occlusion_map: texture_2d<f32>;
@group(0) @binding(5) var sunlight_map: texture_2d<f32>;

fn world_ray(pixel: vec2<i32>) -> vec3<f32> {
    return (transpose(frame.view_from_world) * vec4(normalize(view_ray(pixel)), 0.0)).xyz;
}

@fragment
fn fs_lighting(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    let ray = world_ray(pixel);
    if (textureLoad(depth_map, pixel, 0).x <= 0.0) {
        return vec4(background(ray), 0.0);
    }
    let stored = textureLoad(surface_normals, pixel, 0);
    let albedo = textureLoad(albedo_map, pixel, 0);
    if (is_unlit(stored)) {
        return vec4(albedo.rgb, 1.0);
    }
    let normal = from_octahedral(stored.xy);
    var surface = Reflector(albedo.rgb, albedo.a, stored.z, normal, -ray, abs(stored.w), specular_at(pixel, normal));
    if (OCCLUSION) {
        surface.open *= textureLoad(occlusion_map, pixel, 0).x;
    }
    var sun = frame.sun.rgb;
    if (SHADOWS) {
        let sunlight = textureLoad(sunlight_map, pixel, 0);
        sun *= sunlight.x;
        if (frame.shade == 2u && sunlight.y < 1.0) {
            surface.albedo = level_colour(u32(round(sunlight.y * 255.0)));
        }
    }
    if (stored.w < 0.0) {
        sun = vec3(0.0);
    }
    let distance = view_depth(textureLoad(depth_map, pixel, 0).x) * length(view_ray(pixel));
    return vec4(hazed(lit(surface, sun), ray, distance), 1.0);
}

@fragment
fn fs_sky(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4(background(world_ray(vec2<i32>(at.xy))), 0.0);
}
