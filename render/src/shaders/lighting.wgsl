// Sun and ambient light on the G-buffer, sky where there is no surface.

override OCCLUSION: bool = false;
override SHADOWS: bool = false;

@group(0) @binding(1) var depth_map: texture_2d<f32>;
@group(0) @binding(2) var normal_map: texture_2d<f32>;
@group(0) @binding(3) var albedo_map: texture_2d<f32>;
@group(0) @binding(4) var occlusion_map: texture_2d<f32>;
@group(0) @binding(5) var sunlight_map: texture_2d<f32>;

// Reflectance of dielectrics looking straight at them.
const F0: f32 = 0.04;

fn world_ray(pixel: vec2<i32>) -> vec3<f32> {
    return (transpose(frame.view_from_world) * vec4(normalize(view_ray(pixel)), 0.0)).xyz;
}

// Blinn-Phong with the exponent of a Beckmann lobe of that roughness (Walter et al., 2007:
// n = 2/α² − 2) and normalised (n + 8) / 8 (Akenine-Möller et al., "Real-Time Rendering", 3rd ed.,
// 7.5.1), Schlick's Fresnel term.
fn highlight(normal: vec3<f32>, to_eye: vec3<f32>, to_sun: vec3<f32>, roughness: f32) -> f32 {
    let half_way = normalize(to_eye + to_sun);
    let alpha = roughness * roughness;
    let exponent = max(2.0 / (alpha * alpha) - 2.0, 0.0);
    let lobe = (exponent + 8.0) / 8.0 * pow(max(dot(normal, half_way), 1e-4), exponent);
    let fresnel = F0 + (1.0 - F0) * pow(1.0 - max(dot(half_way, to_eye), 0.0), 5.0);
    return fresnel * lobe;
}

@fragment
fn fs_lighting(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    let ray = world_ray(pixel);
    if (textureLoad(depth_map, pixel, 0).x <= 0.0) {
        return vec4(sky(ray), 0.0);
    }
    let surface = textureLoad(normal_map, pixel, 0);
    let normal = normalize(surface.xyz);
    var albedo = textureLoad(albedo_map, pixel, 0).rgb;
    var open = 1.0;
    if (OCCLUSION) {
        open = textureLoad(occlusion_map, pixel, 0).x;
    }
    var sun = frame.sun.rgb;
    if (SHADOWS) {
        let sunlight = textureLoad(sunlight_map, pixel, 0);
        sun *= sunlight.x;
        if (frame.shade == 2u && sunlight.y < 1.0) {
            albedo = level_colour(u32(round(sunlight.y * 255.0)));
        }
    }
    let to_sun = frame.to_sun.xyz;
    let cosine = max(dot(normal, to_sun), 0.0);
    let diffuse = albedo * (sun * cosine + ambient(normal) * open);
    let shine = sun * cosine * highlight(normal, -ray, to_sun, surface.w);
    let share = environment_brdf(max(dot(normal, -ray), 0.0), surface.w);
    let mirrored = reflected(reflect(ray, normal), surface.w) * (F0 * share.x + share.y) * open;
    let distance = view_depth(textureLoad(depth_map, pixel, 0).x) * length(view_ray(pixel));
    return vec4(hazed(diffuse + shine + mirrored, ray, distance), 1.0);
}

@fragment
fn fs_sky(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4(sky(world_ray(vec2<i32>(at.xy))), 0.0);
}
