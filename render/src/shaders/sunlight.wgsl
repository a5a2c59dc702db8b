// How much of the sun's light reaches each pixel: lookups in the cascades' maps, filtered by percentage of what is nearer
// to the sun (Reeves et al., "Rendering antialiased shadows with depth maps", 1987). Twin: twin/sunlight.rs.

struct Cascade {
    map_from_world: mat4x4<f32>, // from places relative to the eye
    texel: f32, // world units
}

struct Shadows {
    cascades: array<Cascade, 4>, // nearest first
    count: u32,
    filter_width: u32,
}

@group(0) @binding(2) var maps: texture_depth_2d_array;
@group(0) @binding(3) var map_sampler: sampler_comparison;
@group(0) @binding(4) var<uniform> shadows: Shadows;
@group(0) @binding(5) var normal_map: texture_2d<f32>;

// Share of a map's side at its border over which the next one takes over.
const BLEND: f32 = 0.05;
// What rounding of depths may come to, in texels.
const ROUNDING: f32 = 0.1;

// Of a place on a map: the mean of bilinear comparisons around it.
fn lit_at(cascade: u32, place: vec3<f32>) -> f32 {
    let size = f32(textureDimensions(maps).x);
    let width = i32(shadows.filter_width);
    let first = -0.5 * f32(width - 1);
    var sum = 0.0;
    for (var y = 0; y < width; y++) {
        for (var x = 0; x < width; x++) {
            let offset = (vec2(f32(x), f32(y)) + first) / size;
            sum += textureSampleCompareLevel(maps, map_sampler, place.xy + offset, cascade, place.z);
        }
    }
    return sum / f32(width * width);
}

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
        // A facet may face away from the sun where the surface that it stands for does not, and where depths of neighbours
        // belong to other surfaces they say nothing: what the surface is lit by decides.
        normal = normalize(textureLoad(normal_map, pixel, 0).xyz);
        cosine = dot(normal, frame.to_sun.xyz);
        if (cosine <= 0.0) {
            return vec4(0.0, 1.0, 0.0, 0.0);
        }
    }
    let sine = sqrt(max(1.0 - cosine * cosine, 0.0));
    // A lookup reaches so many texels from the place that is asked for, along a side; sqrt(2) as many along the diagonal.
    let reach = 0.5 * f32(shadows.filter_width + 1u) * 1.4142136;

    var lit = 0.0;
    var left = 1.0;
    var by = 255.0;
    for (var i = 0u; i < shadows.count; i++) {
        let cascade = shadows.cascades[i];
        // Off a plane just as far as it falls away from the light within the lookup's reach (after Holbert, "Saying
        // goodbye to shadow acne", 2011), and no further.
        let lifted = position + cascade.texel * (normal * (reach * sine) + frame.to_sun.xyz * ROUNDING);
        let place = (cascade.map_from_world * vec4(lifted, 1.0)).xyz;
        let inside = min(min(place.x, 1.0 - place.x), min(place.y, 1.0 - place.y));
        let border = (reach + 1.0) / f32(textureDimensions(maps).x);
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
    // Beyond the last map all is lit.
    return vec4(lit + left, by / 255.0, 0.0, 0.0);
}
