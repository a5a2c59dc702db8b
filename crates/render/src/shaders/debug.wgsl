// Debug views. CPU reference: cpu_reference/debug.rs.

// `DebugMode` of debug.rs.
override SHOWN: u32 = 0u;
// Whether the target applies the sRGB curve, which must be undone.
override DECODE_SRGB: bool = false;
// Whether what the host drew stays where none of our surfaces is.
override KEEP: bool = false;

@group(0) @binding(1) var depth_map: texture_2d<f32>;
@group(0) @binding(2) var shown_map: texture_2d<f32>;
@group(0) @binding(3) var metal_map: texture_2d<f32>; // where that lies elsewhere

// The G-buffer's encodings.

// Of what is unlit there is none: black.
fn normal_colour(texel: vec4<f32>) -> vec3<f32> {
    return select(0.5 + 0.5 * from_octahedral(texel.xy), vec3(0.0), is_unlit(texel));
}

// Roughness, metal, and how open to the sky the material says that it is.
fn surface_colour(texel: vec4<f32>, albedo: vec4<f32>) -> vec3<f32> {
    return vec3(texel.z, albedo.a, abs(texel.w));
}

fn albedo(texel: vec4<f32>) -> vec3<f32> {
    return texel.rgb;
}

// A colour for each power of two of world units, less bright towards its far end.
fn depth_colour(stored: f32) -> vec3<f32> {
    let octaves = log2(view_depth(stored));
    let octave = floor(octaves);
    return level_colour(u32(octave + 128.0)) * (1.0 - 0.6 * (octaves - octave));
}

// Dark blue over green to dark red, at eight; black is none.
fn count_colour(count: f32) -> vec3<f32> {
    let t = 4.0 * min(count / 8.0, 1.0);
    return select(vec3(0.0), clamp(1.5 - abs(t - vec3(3.0, 2.0, 1.0)), vec3(0.0), vec3(1.0)), count > 0.0);
}

// Of motion since the frame before: right is red, left blue, up green, down dark; by a logarithm, full from 64 pixels on.
fn motion_colour(to_before: vec2<f32>) -> vec3<f32> {
    let way = -to_before * vec2(1.0, -1.0);
    let size = length(way);
    let s = way / max(size, 1e-6) * min(log2(1.0 + size) / 6.0, 1.0);
    return 0.5 + 0.5 * vec3(s.x, s.y, -s.x);
}

// Motion of moving objects, else due to the camera.
fn motion_of(pixel: vec2<i32>, stored: f32, by_itself: vec2<f32>) -> vec2<f32> {
    let moves = SHOWN == 9u && by_itself.x < STANDS;
    return select(motion_of_camera(pixel, stored), by_itself, moves);
}

// IEC 61966-2-1.
fn encoded(x: vec3<f32>) -> vec3<f32> {
    return select(1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, 12.92 * x, x <= vec3(0.0031308));
}

// What is written for a texel, sRGB-encoded.
fn value_of(pixel: vec2<i32>, stored_depth: f32, texel: vec4<f32>, metal: vec4<f32>) -> vec3<f32> {
    switch SHOWN {
        case 1u: { return normal_colour(texel); }
        case 2u: { return encoded(albedo(texel)); }
        case 3u: { return surface_colour(texel, metal); }
        case 4u: { return depth_colour(stored_depth); }
        case 5u: { return texel.xxx; }
        case 6u: { return count_colour(texel.x); }
        case 7u: { return vec3(0.0); }
        case 8u, 9u: { return motion_colour(motion_of(pixel, stored_depth, texel.xy)); }
        default: { return vec3(1.0); }
    }
}

// The texel that a place of the target shows: the nearest, unfiltered, where the picture is enlarged.
fn texel_at(at: vec2<f32>) -> vec2<i32> {
    let target_size = vec2(f32(frame.target_px & 0xffffu), f32(frame.target_px >> 16u));
    return min(vec2<i32>(at * frame.size_px / target_size), vec2<i32>(frame.size_px) - 1);
}

// Whether there is a surface, or an overdraw count.
fn is_shown(texel: vec2<i32>) -> bool {
    let counted = SHOWN == 6u && textureLoad(shown_map, texel, 0).x > 0.0;
    return counted || textureLoad(depth_map, texel, 0).x > 0.0;
}

fn debug(texel: vec2<i32>) -> vec4<f32> {
    var value = vec3(0.0);
    if (is_shown(texel)) {
        let stored = textureLoad(depth_map, texel, 0).x;
        value = value_of(texel, stored, textureLoad(shown_map, texel, 0), textureLoad(metal_map, texel, 0));
    }
    if (DECODE_SRGB) {
        value = linear_from_srgb(value);
    }
    return vec4(value, 1.0);
}

// For targets without depth.
@fragment
fn fs_debug(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let texel = texel_at(at.xy);
    if (KEEP && !is_shown(texel)) {
        discard;
    }
    return debug(texel);
}

struct Debug {
    @location(0) colour: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

// For targets with depth: the depth test keeps the host's nearer surfaces.
@fragment
fn fs_debug_depth(@builtin(position) at: vec4<f32>) -> Debug {
    let texel = vec2<i32>(at.xy);
    let depth = textureLoad(depth_map, texel, 0).x;
    if (KEEP && depth <= 0.0) {
        discard;
    }
    return Debug(debug(texel), depth);
}
