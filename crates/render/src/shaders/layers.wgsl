// Depth lookups of an occlusion estimator in one of sixteen deinterleaved layers: every fourth pixel of every fourth
// row. Pixels of a layer share a rotation, so neighbours read neighbours, which suits caches (Bavoil, "Deinterleaved
// texturing for cache-efficient interleaved sampling", 2014). CPU reference: cpu_reference/occlusion/receiver.rs.

@group(0) @binding(2) var layers: texture_2d_array<f32>;

struct Layer {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) number: u32,
}

// As vs_fullscreen() of fullscreen.wgsl, which cannot be called.
@vertex
fn vs_layer(@builtin(vertex_index) i: u32, @builtin(instance_index) number: u32) -> Layer {
    let corner = vec2(f32((i << 1u) & 2u), f32(i & 2u));
    return Layer(vec4(corner.x * 2.0 - 1.0, 1.0 - corner.y * 2.0, 0.0, 1.0), number);
}

// A layer's pixel in the picture.
fn picture_pixel(at: Layer) -> vec2<i32> {
    return 4 * vec2<i32>(at.position.xy) + vec2<i32>(vec2(at.number & 3u, at.number >> 2u));
}

// Pixels to go for a share of the radius: from the layer's next one on, which is four of the picture's away.
fn march_px(r: Receiver, share: f32) -> f32 {
    return mix(4.0, max(r.radius * frame.scale_px / r.depth, 4.0), share);
}

// What is drawn at the layer's pixel that is nearest to an offset in pixels of the picture: as in whole.wgsl.
fn drawn_at(r: Receiver, offset_px: vec2<f32>) -> vec3<f32> {
    let there = r.pixel + 4 * vec2<i32>(floor((offset_px + 2.0) / 4.0));
    if (any(there < vec2(0)) || any(there >= vec2<i32>(frame.size_px)) || all(there == r.pixel)) {
        return vec3(0.0);
    }
    let number = (there.y & 3) * 4 + (there.x & 3);
    let depth = view_depth(textureLoad(layers, there >> vec2(2u), number, 0).x);
    return select(view_ray(there) * depth - r.centre, vec3(0.0), depth >= FAR);
}

// Depths of a layer. Beyond the picture there is nothing.
@fragment
fn fs_split(at: Layer) -> @location(0) vec4<f32> {
    let pixel = picture_pixel(at);
    if (any(pixel >= vec2<i32>(textureDimensions(depth_map)))) {
        return vec4(0.0);
    }
    return vec4(textureLoad(depth_map, pixel, 0).x, 0.0, 0.0, 0.0);
}

@fragment
fn fs_layer(at: Layer) -> @location(0) vec4<f32> {
    let pixel = picture_pixel(at);
    if (any(pixel >= vec2<i32>(frame.size_px))) {
        return vec4(1.0);
    }
    return vec4(open_at(pixel, pixel));
}

// The layers as one picture again.
@fragment
fn fs_joined(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    return textureLoad(layers, pixel >> vec2(2u), (pixel.y & 3) * 4 + (pixel.x & 3), 0);
}
