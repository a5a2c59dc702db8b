// Surfaces to depth, world normal + roughness, and albedo.

// Compiled in for materials with a height map only.
override RELIEF: bool = false;

struct Material {
    base_colour: vec3<f32>,
    roughness: f32,
    relief_depth: f32, // units of texture coordinates
}

@group(1) @binding(0) var<uniform> material: Material;
@group(1) @binding(1) var colour_map: texture_2d<f32>;
@group(1) @binding(2) var height_map: texture_2d<f32>;
@group(1) @binding(3) var map_sampler: sampler;

struct VertexIn {
    @location(0) position: vec3<f32>,
    @location(1) birth_s: f32,
    @location(2) morph_from: vec3<f32>,
    @location(3) level: u32,
    @location(4) uv: vec2<f32>,
    @location(5) normal: vec4<f32>,
    @location(6) colour: vec4<f32>, // sRGB-encoded
    @location(7) offset_scale: vec4<f32>,
    @location(8) rotation: vec4<f32>,
}

struct Surface {
    @builtin(position) clip: vec4<f32>,
    @location(0) position: vec3<f32>, // world axes, relative to the eye
    @location(1) normal: vec3<f32>,
    @location(2) uv: vec2<f32>, // v down, as textures are stored
    @location(3) @interpolate(flat) level: u32,
    @location(4) colour: vec3<f32>, // linear, so that what lies between vertices is too
}

struct GBuffer {
    @location(0) normal_roughness: vec4<f32>,
    @location(1) albedo: vec4<f32>,
}

// Geomorph (Hoppe, "Progressive Meshes", 1996, section 3.2): how far a vertex has come from the
// position it split from.
fn morph_weight(age_s: f32) -> f32 {
    if (frame.morph_s <= 0.0) {
        return 1.0;
    }
    return smoothstep(0.0, 1.0, clamp(age_s, 0.0, frame.morph_s) / frame.morph_s);
}

// Position of a vertex now, world axes, relative to the eye.
fn placed(v: VertexIn) -> vec3<f32> {
    let local = mix(v.morph_from, v.position, morph_weight(frame.time_s - v.birth_s));
    return rotate(v.rotation, local * v.offset_scale.w) + v.offset_scale.xyz;
}

fn clip_position(world: vec3<f32>) -> vec4<f32> {
    return frame.clip_from_view * vec4((frame.view_from_world * vec4(world, 0.0)).xyz, 1.0);
}

@vertex
fn vs_surface(v: VertexIn) -> Surface {
    var out: Surface;
    out.position = placed(v);
    out.clip = clip_position(out.position);
    out.normal = rotate(v.rotation, v.normal.xyz);
    out.uv = vec2(v.uv.x, 1.0 - v.uv.y);
    out.level = v.level;
    out.colour = linear_from_srgb(v.colour.rgb);
    return out;
}

@fragment
fn fs_surface(s: Surface, @builtin(front_facing) front: bool) -> GBuffer {
    // Derivatives first: they need uniform control flow.
    let dp_dx = dpdx(s.position);
    let dp_dy = dpdy(s.position);
    let duv_dx = dpdx(s.uv);
    let duv_dy = dpdy(s.uv);
    let view_length = max(length(s.position), 1e-30);
    let view = s.position / view_length; // from the eye to the surface

    // Both sides are drawn; on a back face the normal is flipped. A vertex without a usable normal
    // (isolated or degenerate star) faces the eye.
    var normal = select(-s.normal, s.normal, front);
    let normal_length = length(normal);
    normal = select(-view, normal / normal_length, normal_length > 1e-6);

    var uv = s.uv;
    if (RELIEF) {
        let hit = relief(s.uv, normal, view, view_length, dp_dx, dp_dy, duv_dx, duv_dy);
        uv = hit.uv;
        normal = hit.normal;
    }

    let texel = textureSampleGrad(colour_map, map_sampler, uv, duv_dx, duv_dy).rgb;
    var albedo = material.base_colour * s.colour * texel;
    if (frame.shade == 1u) {
        albedo = level_colour(s.level);
    }
    var out: GBuffer;
    out.normal_roughness = vec4(normal, material.roughness);
    out.albedo = vec4(albedo, 1.0);
    return out;
}

// Into a map of shadows: `frame` is then as the sun sees it.
@vertex
fn vs_caster(v: VertexIn) -> @builtin(position) vec4<f32> {
    return clip_position(placed(v));
}

// Edges, counted. Moved towards the eye by two thousandths of their depth, which keeps them in
// front of the faces they belong to.
@vertex
fn vs_wire(v: VertexIn) -> @builtin(position) vec4<f32> {
    var clip = clip_position(placed(v));
    clip.z *= 1.002;
    return clip;
}

@fragment
fn fs_wire() -> @location(0) vec4<f32> {
    return vec4(EDGE, 0.0, 0.0, 1.0);
}
