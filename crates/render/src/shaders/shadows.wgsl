// Shadow lookup in the cascades with percentage-closer filtering (Reeves et al., "Rendering antialiased shadows with
// depth maps", 1987). CPU reference: cpu_reference/sunlight.rs.

struct Cascade {
    map_from_world: mat4x4<f32>, // from places relative to the eye
    texel: f32, // world units
}

struct Shadows {
    cascades: array<Cascade, 4>, // nearest first
    count: u32,
    filter_width: u32,
}

@group(0) @binding(2) var shadow_maps: texture_depth_2d_array;
@group(0) @binding(3) var shadow_sampler: sampler_comparison;
@group(0) @binding(4) var<uniform> shadows: Shadows;
// Share of a map's side at its border over which the next one takes over.
const BLEND: f32 = 0.05;
// Bound of depth rounding, in texels.
const ROUNDING: f32 = 0.1;

// Filtered lookup: mean of bilinear comparisons around a position.
fn lit_at(cascade: u32, place: vec3<f32>) -> f32 {
    let size = f32(textureDimensions(shadow_maps).x);
    let width = i32(shadows.filter_width);
    let first = -0.5 * f32(width - 1);
    var sum = 0.0;
    for (var y = 0; y < width; y++) {
        for (var x = 0; x < width; x++) {
            let offset = (vec2(f32(x), f32(y)) + first) / size;
            sum += textureSampleCompareLevel(shadow_maps, shadow_sampler, place.xy + offset, cascade, place.z);
        }
    }
    return sum / f32(width * width);
}

// Share of the sun's light at a surface position relative to the eye, whose normal is at this cosine to the sun, and
// the index of the cascade in 255ths.
fn sunlight_at(position: vec3<f32>, normal: vec3<f32>, cosine: f32) -> vec2<f32> {
    let sine = sqrt(max(1.0 - cosine * cosine, 0.0));
    // Radius of the filter in texels along a side; √2 times as much along the diagonal.
    let reach = 0.5 * f32(shadows.filter_width + 1u) * 1.4142136;

    var lit = 0.0;
    var left = 1.0;
    var by = 255.0;
    for (var i = 0u; i < shadows.count; i++) {
        let cascade = shadows.cascades[i];
        // Normal offset: just as far as the plane falls away from the light within the filter's radius (after Holbert,
        // "Saying goodbye to shadow acne", 2011).
        let lifted = position + cascade.texel * (normal * (reach * sine) + frame.to_sun.xyz * ROUNDING);
        let place = (cascade.map_from_world * vec4(lifted, 1.0)).xyz;
        let inside = min(min(place.x, 1.0 - place.x), min(place.y, 1.0 - place.y));
        let border = (reach + 1.0) / f32(textureDimensions(shadow_maps).x);
        let weight = clamp((inside - border) / BLEND, 0.0, 1.0) * f32(place.z > 0.0);
        if (weight <= 0.0) {
            continue;
        }
        by = select(by, f32(i), by == 255.0);
        lit += left * weight * lit_at(i, place);
        left *= 1.0 - weight;
        if (left <= 0.0) {
            break;
        }
    }
    // Beyond the last cascade everything is lit.
    return vec2(lit + left, by / 255.0);
}
