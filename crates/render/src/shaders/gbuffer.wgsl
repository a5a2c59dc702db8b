// Writes the G-buffer: depth, world normal, roughness, occlusion, albedo and metalness.

// Compiled in only for materials with a height map, a normal or surface map, alpha test, maps with tiled levels,
// specular reflection of their own, transmission or maps that use the second set of texture coordinates, and with section
// planes.
override RELIEF: bool = false;
override MAPS: bool = false;
override MASK: bool = false;
override TILED: bool = false;
override SPECULAR: bool = false;
override TRANSMITS: bool = false;
override SECOND_UV: bool = false;
override SECTIONS: bool = false;
// Only for assets whose parts have states. Some drivers run all that vertices might need.
override STATES: bool = false;

// A map with tiled levels (tiled.wgsl).
struct TiledMap {
    levels: u32, // 0: all of the map is in its texture
    whole: u32, // levels that are in its texture, coarsest first
    size: vec2<u32>, // of the finest, texels
    tables: array<vec4<u32>, 2>, // where in the page table the words of each tiled level begin, coarsest first
}

struct Material {
    base_colour: vec4<f32>, // with opacity
    emission: vec3<f32>,
    normal_scale: f32,
    roughness: f32,
    metallic: f32,
    occlusion: f32,
    cutoff: f32, // of opacity
    relief_depth: f32, // units of texture coordinates
    unlit: u32,
    flat_faces: u32,
    wrap: u32, // of u, and of v from bit 8 on: 0 repeat, 1 clamp, 2 mirror
    specular: u32, // see specular_of() in brdf.wgsl
    coat: u32, // without its normal
    transmission: f32,
    second_uv: u32, // a bit for each of `tiled` that uses the second set of texture coordinates
    tiled: array<TiledMap, 5>, // colour, surface, normal, emission, occlusion
}

const COLOUR: u32 = 0u;
const SURFACE: u32 = 1u;
const NORMAL: u32 = 2u;
const EMISSION: u32 = 3u;
const OCCLUSION: u32 = 4u;

@group(1) @binding(0) var<uniform> material: Material;
@group(1) @binding(1) var colour_map: texture_2d<f32>;
@group(1) @binding(2) var height_map: texture_2d<f32>;
@group(1) @binding(3) var map_sampler: sampler;
@group(1) @binding(4) var surface_map: texture_2d<f32>; // occlusion, roughness, metal
@group(1) @binding(5) var normal_map: texture_2d<f32>;
@group(1) @binding(6) var emission_map: texture_2d<f32>;
@group(1) @binding(9) var occlusion_map: texture_2d<f32>; // beside that of the surface map

// Of the sun's angle to the normal, where shadows begin below a surface.
const SUNKEN_LEAST_COSINE: f32 = 0.25;

struct Surface {
    // Invariant: all passes must compute equal depths.
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) position: vec3<f32>, // world axes, relative to the eye
    @location(1) normal: vec3<f32>,
    @location(2) uv: vec2<f32>, // v down, as textures are stored
    @location(3) @interpolate(flat) level: u32,
    @location(4) colour: vec4<f32>, // linear, so that what lies between vertices is too; with opacity
    @location(5) @interpolate(flat) tint: u32, // sRGB in the low three bytes, red lowest; above, its share of 127
    @location(6) second_uv: vec2<f32>, // v down
}

// Texture coordinates and their screen-space derivatives.
struct Lookup {
    uv: vec2<f32>,
    dx: vec2<f32>,
    dy: vec2<f32>,
}

fn uses_second_uv(slot: u32) -> bool {
    return SECOND_UV && ((material.second_uv >> slot) & 1u) != 0u;
}

// The texture coordinates that a map uses.
fn uv_for(slot: u32, first: vec2<f32>, second: vec2<f32>) -> vec2<f32> {
    if (uses_second_uv(slot)) {
        return second;
    }
    return first;
}

fn lookup_for(slot: u32, first: Lookup, second: Lookup) -> Lookup {
    if (uses_second_uv(slot)) {
        return second;
    }
    return first;
}

// A shaded surface point.
struct Shaded {
    albedo: vec3<f32>,
    opacity: f32,
    normal: vec3<f32>,
    roughness: f32,
    metal: f32,
    occlusion: f32,
    at: vec3<f32>, // world axes, relative to the eye; below the surface where relief says so
}

// Gradients of u and v along a surface from screen-space derivatives (Schüler, "Normal mapping without precomputed
// tangents", 2006, revisited 2013): grad u . dp = du for both screen directions, grad u . n = 0.
struct Gradients {
    u: vec3<f32>,
    v: vec3<f32>,
    exist: bool,
}

fn gradients(
    normal: vec3<f32>, dp_dx: vec3<f32>, dp_dy: vec3<f32>, duv_dx: vec2<f32>, duv_dy: vec2<f32>,
) -> Gradients {
    let across_y = cross(dp_dy, normal);
    let across_x = cross(normal, dp_dx);
    let det = dot(dp_dx, across_y);
    let exist = abs(det) >= 1e-30;
    let scale = select(0.0, 1.0 / det, exist);
    return Gradients(
        (across_y * duv_dx.x + across_x * duv_dy.x) * scale,
        (across_y * duv_dx.y + across_x * duv_dy.y) * scale,
        exist,
    );
}

// A normal from its map, in the frame of both gradients: x along u, y against the stored v, which runs down.
fn mapped_normal(texel: vec3<f32>, normal: vec3<f32>, along: Gradients) -> vec3<f32> {
    let longest = max(dot(along.u, along.u), dot(along.v, along.v));
    if (!along.exist || longest < 1e-30) {
        return normal;
    }
    let slope = (texel * 2.0 - 1.0) * vec3(material.normal_scale, material.normal_scale, 1.0);
    let tilted = (along.u * slope.x - along.v * slope.y) * inverseSqrt(longest) + normal * slope.z;
    let len = length(tilted);
    return select(normal, tilted / len, len > 1e-6);
}

fn tinted(colour: vec3<f32>, tint: u32) -> vec3<f32> {
    if (tint == 0u) {
        return colour;
    }
    return mix(colour, linear_from_srgb(unpack4x8unorm(tint).rgb), f32(tint >> 24u) / 127.0);
}

// The unit normal of a surface from its screen-space derivatives, towards the eye; zero where they span nothing.
fn face_normal(dp_dx: vec3<f32>, dp_dy: vec3<f32>, view: vec3<f32>) -> vec3<f32> {
    // Scaled first: products of small derivatives would vanish.
    let scale = max(max(length(dp_dx), length(dp_dy)), 1e-30);
    let across = cross(dp_dx / scale, dp_dy / scale);
    let size = length(across);
    let normal = select(vec3(0.0), across / size, size > 1e-12);
    return select(normal, -normal, dot(normal, view) > 0.0);
}

// The unit normal without maps and relief; `view` is the direction from the eye.
fn own_normal(s: Surface, front: bool, dp_dx: vec3<f32>, dp_dy: vec3<f32>, view: vec3<f32>) -> vec3<f32> {
    // Both sides are drawn; on a back face the normal is flipped. A vertex without a usable normal
    // (isolated or degenerate star) faces the eye.
    var normal = select(-s.normal, s.normal, front);
    if (material.flat_faces == 1u) {
        normal = face_normal(dp_dx, dp_dy, view);
    }
    let normal_length = length(normal);
    return select(-view, normal / normal_length, normal_length > 1e-6);
}

// All of a surface at a fragment. In uniform control flow, for derivatives.
fn shaded(s: Surface, front: bool) -> Shaded {
    let dp_dx = dpdx(s.position);
    let dp_dy = dpdy(s.position);
    var first = Lookup(s.uv, dpdx(s.uv), dpdy(s.uv));
    let second = Lookup(s.second_uv, dpdx(s.second_uv), dpdy(s.second_uv));
    let view_length = max(length(s.position), 1e-30);
    let view = s.position / view_length; // from the eye to the surface
    let normal = own_normal(s, front, dp_dx, dp_dy, view);

    var sunlit = true;
    var out = Shaded(vec3(0.0), 1.0, normal, material.roughness, material.metallic, material.occlusion, s.position);
    if (RELIEF || MAPS) {
        if (RELIEF) {
            let along = gradients(normal, dp_dx, dp_dy, first.dx, first.dy);
            let hit = relief(s.uv, normal, view, view_length, along, first.dx, first.dy);
            first.uv = hit.uv;
            out.normal = hit.normal;
            sunlit = hit.sunlit;
            out.at += hit.sunk;
        }
        if (MAPS) {
            let at = lookup_for(NORMAL, first, second);
            let along = gradients(normal, dp_dx, dp_dy, at.dx, at.dy);
            out.normal = mapped_normal(filtered(normal_map, NORMAL, at).xyz, out.normal, along);
            let surface = filtered(surface_map, SURFACE, lookup_for(SURFACE, first, second));
            out.occlusion *= surface.r;
            out.roughness *= surface.g;
            out.metal *= surface.b;
            if (SECOND_UV) {
                out.occlusion *= filtered(occlusion_map, OCCLUSION, lookup_for(OCCLUSION, first, second)).r;
            }
        }
    }
    let texel = filtered(colour_map, COLOUR, lookup_for(COLOUR, first, second));
    let colour = material.base_colour * s.colour * texel;
    out.albedo = tinted(colour.rgb, s.tint);
    out.opacity = colour.a;
    if (frame.shade == 1u) {
        out.albedo = level_colour(s.level);
    }
    // Narrower lobes than this flicker.
    out.roughness = clamp(out.roughness, 0.05, 1.0);
    if (RELIEF && !sunlit) {
        out.occlusion = hidden_from_sun(out.occlusion);
    }
    return out;
}

// The surface that fills a solid where a section plane cuts it, in the mean of its colours.
fn cap(s: Surface, plane: u32) -> GBuffer {
    let mean = textureSampleLevel(colour_map, map_sampler, vec2(0.5), f32(textureNumLevels(colour_map)) - 1.0);
    var albedo = tinted((material.base_colour * s.colour * mean).rgb, s.tint);
    if (frame.shade == 1u) {
        albedo = level_colour(s.level);
    }
    return g_buffer(frame.sections[plane].xyz, CAP_ROUGHNESS, 1.0, albedo, 0.0, material.unlit == 1u);
}

// The plane whose cap hides a fragment; SECTION_PLANES if none does. Back faces are seen only through a cut; an eye that is
// itself in what is kept sees those of open meshes.
fn cap_before(s: Surface, front: bool) -> u32 {
    if (front) {
        return SECTION_PLANES;
    }
    return section_entry(s.position).plane;
}

@fragment
fn fs_surface(s: Surface, @builtin(front_facing) front: bool) -> GBuffer {
    let surface = shaded(s, front);
    if ((MASK && surface.opacity < material.cutoff) || (SECTIONS && is_cut(s.position))) {
        discard;
    }
    if (SECTIONS) {
        let plane = cap_before(s, front);
        if (plane < SECTION_PLANES) {
            return cap(s, plane);
        }
    }
    return g_buffer(surface.normal, surface.roughness, surface.occlusion, surface.albedo, surface.metal, material.unlit == 1u);
}

struct DeepGBuffer {
    @location(0) normal: vec4<f32>,
    @location(1) albedo: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

// Writes the relief's depth (Settings::relief_in_depth).
@fragment
fn fs_deep_surface(s: Surface, @builtin(front_facing) front: bool) -> DeepGBuffer {
    let surface = shaded(s, front);
    if ((MASK && surface.opacity < material.cutoff) || (SECTIONS && is_cut(s.position))) {
        discard;
    }
    if (SECTIONS) {
        let plane = cap_before(s, front);
        if (plane < SECTION_PLANES) {
            let filled = cap(s, plane);
            return DeepGBuffer(filled.normal, filled.albedo, s.clip.z);
        }
    }
    let stored = g_buffer(surface.normal, surface.roughness, surface.occlusion, surface.albedo, surface.metal, material.unlit == 1u);
    let ahead = -(frame.view_from_world * vec4(surface.at, 0.0)).z;
    return DeepGBuffer(stored.normal, stored.albedo, clamp(frame.near / max(ahead, frame.near), 0.0, 1.0));
}

// Specular reflection that is not the usual, as specular_of() of brdf.wgsl reads it. A coat lies over normal map and relief.
@fragment
fn fs_specular(s: Surface, @builtin(front_facing) front: bool) -> @location(0) vec2<u32> {
    var place = vec2(1023u);
    if (MAPS) {
        let view = s.position / max(length(s.position), 1e-30);
        let normal = own_normal(s, front, dpdx(s.position), dpdy(s.position), view);
        place = vec2<u32>(round((octahedral(normal) + 1.0) * 511.0));
    }
    return vec2(material.specular, material.coat | (place.x << 12u) | (place.y << 22u));
}

// Emission over the lit picture.
@fragment
fn fs_emission(s: Surface) -> @location(0) vec4<f32> {
    let texel = emitted(uv_for(EMISSION, s.uv, s.second_uv));
    // Haze takes its share; what it adds is there already.
    let left = exp(-min(max(frame.sky_side.w, 0.0) * length(s.position), 80.0));
    return vec4(min(material.emission * texel, vec3(MAX_RADIANCE)) * left, 0.0);
}

// Shadow casters with relief in depth, from its deepest point: otherwise the relief would lie in the shadow of its own
// surface.
@fragment
fn fs_sunken(s: Surface, @builtin(front_facing) front: bool) -> @builtin(frag_depth) f32 {
    let dp_dx = dpdx(s.position);
    let dp_dy = dpdy(s.position);
    var normal = normalize(select(-s.normal, s.normal, front));
    if (material.flat_faces == 1u) {
        normal = face_normal(dp_dx, dp_dy, s.position);
    }
    let along = gradients(normal, dp_dx, dp_dy, dpdx(s.uv), dpdy(s.uv));
    if (MASK && material.base_colour.a * s.colour.a * map_opacity(uv_for(COLOUR, s.uv, s.second_uv)) < material.cutoff) {
        discard;
    }
    if (SECTIONS && is_cut(s.position)) {
        discard;
    }
    let density = sqrt(length(along.u) * length(along.v));
    let depth = select(0.0, material.relief_depth / max(density, 1e-30), along.exist);
    // So far the light goes on to the deepest, but where it is nearly along the surface.
    let way = depth / max(abs(dot(normal, frame.to_sun.xyz)), SUNKEN_LEAST_COSINE);
    return clamp(s.clip.z - way * frame.clip_from_view[2][2], 0.0, 1.0);
}

// Alpha-tested shadow casters.
struct Pierced {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv: vec2<f32>,
    @location(1) opacity: f32,
    @location(2) second_uv: vec2<f32>,
}

fn is_hole(p: Pierced) -> bool {
    return material.base_colour.a * p.opacity * map_opacity(uv_for(COLOUR, p.uv, p.second_uv)) < material.cutoff;
}

@fragment
fn fs_pierced(p: Pierced) {
    if (is_hole(p)) {
        discard;
    }
}

// Counted as in overdraw.wgsl.
@fragment
fn fs_pierced_overdraw(p: Pierced) -> @location(0) vec4<f32> {
    if (is_hole(p)) {
        discard;
    }
    return vec4(1.0, 0.0, 0.0, 0.0);
}

// Edges, counted.
@fragment
fn fs_wire() -> @location(0) vec4<f32> {
    return vec4(EDGE, 0.0, 0.0, 1.0);
}

// With section planes: whether nothing of a surface is at a fragment. In uniform control flow, for derivatives.
fn is_cut_or_hole(s: Surface) -> bool {
    let hole = MASK && material.base_colour.a * s.colour.a * map_opacity(uv_for(COLOUR, s.uv, s.second_uv)) < material.cutoff;
    return hole || is_cut(s.position);
}

// Shadow casters with section planes. The sun sees no caps: what it sees through a cut lies below them.
@fragment
fn fs_cut_caster(s: Surface) {
    if (is_cut_or_hole(s)) {
        discard;
    }
}

@fragment
fn fs_cut_overdraw(s: Surface) -> @location(0) vec4<f32> {
    if (is_cut_or_hole(s)) {
        discard;
    }
    return vec4(1.0, 0.0, 0.0, 0.0);
}

// The place of an edge is that of its pixel.
@fragment
fn fs_cut_wire(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let depth = frame.near * (1.0 + WIRE_AHEAD * frame.to_sun.w) / at.z;
    if (is_cut((transpose(frame.view_from_world) * vec4(view_ray(vec2<i32>(at.xy)) * depth, 0.0)).xyz)) {
        discard;
    }
    return vec4(EDGE, 0.0, 0.0, 1.0);
}
