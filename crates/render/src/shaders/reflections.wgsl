// Screen-space reflections on smooth surfaces, in place of the sky's reflection that lighting.wgsl has added. CPU
// reference: cpu_reference/reflections.rs.

override OCCLUSION: bool = false;

@group(0) @binding(2) var surface_normals: texture_2d<f32>;
@group(0) @binding(3) var albedo_map: texture_2d<f32>;
@group(0) @binding(4) var occlusion_map: texture_2d<f32>;
@group(0) @binding(5) var lit_map: texture_2d<f32>;
@group(0) @binding(6) var pyramid: texture_2d<f32>;
@group(0) @binding(7) var<uniform> tracing: Tracing;

@fragment
fn fs_reflections(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    let depth = depth_at(pixel);
    let stored = textureLoad(surface_normals, pixel, 0);
    let roughness = stored.z;
    let normal = from_octahedral(stored.xy);
    let coating = specular_at(pixel, normal);
    let is_coated = coating.coat > 0.0 && coating.coat_roughness < MIRRORS.y;
    if (depth >= FAR || is_unlit(stored) || (roughness >= MIRRORS.y && !is_coated)) {
        return vec4(0.0);
    }
    let albedo = textureLoad(albedo_map, pixel, 0);
    let place = view_ray(pixel) * depth;
    let to_eye = -normalize(place);
    let view_normal = (frame.view_from_world * vec4(normal, 0.0)).xyz;
    let direction = reflect(-to_eye, view_normal);
    let met = trace(place, normal_at(pixel, place), direction);
    if (met.share <= 0.0) {
        return vec4(0.0);
    }
    // As from_sky() of brdf.wgsl weighs what it mirrors.
    let cosine = clamp(dot(view_normal, to_eye), 1e-3, 1.0);
    let split = environment_brdf(cosine, roughness);
    let world_to_eye = (transpose(frame.view_from_world) * vec4(to_eye, 0.0)).xyz;
    let surface = Reflector(albedo.rgb, albedo.a, roughness, normal, world_to_eye, 1.0, coating);
    let specular = mixed_specular(surface);
    let mirrored = specular.f0 * split.x + specular.f90 * split.y;
    var open = stored.w;
    if (OCCLUSION) {
        open *= textureLoad(occlusion_map, pixel, 0).x;
    }
    let world = (transpose(frame.view_from_world) * vec4(direction, 0.0)).xyz;
    let seen = textureLoad(lit_map, met.pixel, 0).rgb;
    let difference = seen - reflected(world, roughness);
    var clear = 1.0;
    if (frame.sky_side.w > 0.0) {
        clear = exp(-min(frame.sky_side.w * length(place), 80.0));
    }
    let share = met.share * mirrors(roughness) * mirror_open(open, cosine, roughness) * clear;
    let below = mirrored * difference * share;
    if (!is_coated) {
        return vec4(below * (1.0 - coat_cover(surface)), 0.0);
    }
    // Along the same ray: over a normal map a coat has another normal.
    let coat_share = met.share * mirrors(coating.coat_roughness) * mirror_open(open, cosine, coating.coat_roughness) * clear;
    let coat = coat_mirrored(surface, cosine) * (seen - reflected(world, coating.coat_roughness)) * coat_share;
    return vec4(below * (1.0 - coat_cover(surface)) + coat, 0.0);
}
