// Lookups in the sky maps: radiance, irradiance, reflections; and haze. CPU reference: cpu_reference/sky.rs.
//
// Maps are octahedral (Meyer et al., "On Floating-Point Normal Vectors", 2010) in axes of which z is up and x lies below
// the sun, and have a border of one texel, so that filtering crosses their edges.

// Radiance without the sun's disc.
@group(0) @binding(10) var sky_map: texture_2d<f32>;
// Prefiltered reflections, smoothest first.
@group(0) @binding(11) var reflection_map: texture_2d_array<f32>;
@group(0) @binding(12) var sky_sampler: sampler;
@group(0) @binding(13) var split_sum: texture_2d<f32>;

// A direction of the world in the maps' axes.
fn sky_axes(direction: vec3<f32>) -> vec3<f32> {
    let up = frame.up.xyz;
    let side = frame.sky_side.xyz;
    return vec3(dot(direction, side), dot(direction, cross(up, side)), dot(direction, up));
}

// Place of a direction (in the maps' axes) in a map with `texels` along a side, borders included.
fn map_place(direction: vec3<f32>, texels: f32) -> vec2<f32> {
    return ((0.5 + 0.5 * octahedral(direction)) * (texels - 2.0) + 1.0) / texels;
}

fn sky_without_sun(direction: vec3<f32>) -> vec3<f32> {
    let place = map_place(sky_axes(direction), f32(textureDimensions(sky_map).x));
    return textureSampleLevel(sky_map, sky_sampler, place, 0.0).rgb;
}

// Radiance of the sky in a direction.
fn sky(direction: vec3<f32>) -> vec3<f32> {
    let radiance = sky_without_sun(direction);
    // The sun's disc by its chord, since cosines near 1 have no digits left; its edge is blurred by a twentieth.
    let away = distance(direction, frame.to_sun.xyz) / frame.sun_disc.w;
    let disc = 1.0 - smoothstep(0.95, 1.05, away);
    let above = step(0.0, dot(direction, frame.up.xyz));
    return radiance + frame.sun_disc.rgb * (disc * above);
}

// Radiance that is shown in a direction without a surface.
fn background(direction: vec3<f32>) -> vec3<f32> {
    if (frame.background.w > 0.0) {
        return frame.background.rgb;
    }
    return sky(direction);
}

// Radiance of a white diffuse surface in the light of the whole sky: irradiance over π (Ramamoorthi and Hanrahan 2001).
fn ambient(normal: vec3<f32>) -> vec3<f32> {
    let n = sky_axes(normal);
    let c = &frame.irradiance;
    let even = (*c)[0].rgb + (*c)[1].rgb * n.y + (*c)[2].rgb * n.z + (*c)[3].rgb * n.x;
    let squares = (*c)[6].rgb * (3.0 * n.z * n.z - 1.0) + (*c)[8].rgb * (n.x * n.x - n.y * n.y);
    let products = (*c)[4].rgb * (n.x * n.y) + (*c)[5].rgb * (n.y * n.z) + (*c)[7].rgb * (n.x * n.z);
    return max(even + squares + products, vec3(0.0));
}

// Mean radiance of the sky in the lobe of a surface of this perceptual roughness around the mirrored direction, without
// the sun's disc: the first half of the split sum (Karis, "Real Shading in Unreal Engine 4", 2013).
fn reflected(direction: vec3<f32>, roughness: f32) -> vec3<f32> {
    let place = map_place(sky_axes(direction), f32(textureDimensions(reflection_map).x));
    let last = f32(textureNumLayers(reflection_map) - 1u);
    let layer = clamp(roughness, 0.0, 1.0) * last;
    let low = floor(layer);
    let smoother = textureSampleLevel(reflection_map, sky_sampler, place, i32(low), 0.0).rgb;
    let rougher = textureSampleLevel(reflection_map, sky_sampler, place, i32(min(low + 1.0, last)), 0.0).rgb;
    return mix(smoother, rougher, layer - low);
}

// Scale and bias on the reflectance at normal incidence under a uniform sky: the second half of the split sum, from a
// table for GGX with Smith's shadowing. `cosine` is between normal and eye.
fn environment_brdf(cosine: f32, roughness: f32) -> vec2<f32> {
    let side = f32(textureDimensions(split_sum).x);
    let place = (clamp(vec2(sqrt(max(cosine, 0.0)), roughness), vec2(0.0), vec2(1.0)) * (side - 1.0) + 0.5) / side;
    return textureSampleLevel(split_sum, sky_sampler, place, 0.0).xy;
}

// Radiance after a distance in haze: it approaches the sky's radiance on that ray.
fn hazed(radiance: vec3<f32>, ray: vec3<f32>, distance: f32) -> vec3<f32> {
    if (frame.sky_side.w <= 0.0) {
        return radiance;
    }
    return mix(sky_without_sun(ray), radiance, exp(-min(frame.sky_side.w * distance, 80.0)));
}
