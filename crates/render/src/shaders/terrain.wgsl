// Draws terrain tiles into depth, normal, roughness and albedo.
//
// A tile is TILE_CELLS² cells of one spacing; its heights lie in an atlas, CELL_SAMPLES to a cell's side, with a margin
// that normals need. Normals are looked up by pixel, as slopes between samples. Everything that two tiles share is
// computed from integers by the same operations, so that they agree to the bit. CPU reference: cpu_reference/terrain.rs.

// Compiled in where relief mapping is on.
override RELIEF: bool = false;

const TILE_CELLS: i32 = 8;
const CELL_SAMPLES: i32 = 2;
// Unit of slopes, in height units per sample.
const SLOPE_UNIT: f32 = 1024.0;

struct Terrain {
    // From the corner of the eye's grid cell to the eye, world units; y from the nearest height unit.
    eye_fraction: vec3<f32>,
    eye_height: i32, // in height units
    unit: f32, // world units per grid unit
    height_unit: f32, // world units per height unit
    above: f32, // of the eye over the highest ground around, not below 0
    relief_depth: f32, // world units
    // Heights above which grass, hill and snow begin, and half the width over which one becomes the other; world units.
    zones: vec4<f32>,
    // The eye in each scale's repetition, world units: x, z of the near scale, of the far one.
    eye_in_near: vec2<f32>,
    eye_in_far: vec2<f32>,
    // Lengths of one repetition of the near and far scale, world units, and of the patches that break them up.
    periods: vec2<f32>,
    eye_up: vec2<f32>, // the same upwards
}

@group(1) @binding(0) var<uniform> terrain: Terrain;
@group(1) @binding(1) var tile_heights: texture_2d<i32>;
@group(1) @binding(2) var layers: texture_2d_array<f32>; // rgb colour, a height
@group(1) @binding(3) var layer_sampler: sampler;

// Rough regions: capsules in and around which points morph later.
struct Regions {
    lines: array<vec4<f32>, 32>, // ends of segments, relative to the eye
    radii: array<vec4<f32>, 8>, // four regions to a vector
    // Morph distances by region, two spacings to a vector.
    morph: array<vec4<f32>, 512>,
}

@group(1) @binding(4) var<uniform> regions: Regions;

// Slopes along both axes, of a tile and of the next coarser one.
@group(1) @binding(5) var slopes: texture_2d<f32>;

// Slope at which a region's distances shrink beyond its margin.
const FALLOFF: f32 = 64.0;
// Diagonal of a tile of spacing 0, grid units.
const DIAGONAL: f32 = 11.313708;

struct TileIn {
    @builtin(vertex_index) vertex: u32, // row · (TILE_CELLS + 1) + column
    @location(0) from_eye: vec2<i32>, // its first grid point, from the eye's cell, grid units
    @location(1) atlas: vec2<i32>, // texel of the tile's first point
    @location(2) morph: vec2<f32>, // distances where points begin to slide and have arrived, away from rough regions
    @location(3) spacing_regions: vec2<u32>, // binary logarithm, grid units; bits of the regions that may matter
}

struct Ground {
    @builtin(position) clip: vec4<f32>,
    @location(0) position: vec3<f32>, // world axes, relative to the eye
    @location(1) sample: vec2<f32>, // texel of the atlas
    @location(2) height: f32, // world units, absolute
    @location(3) coarser: f32, // how far on the way to the next coarser surface
    @location(4) @interpolate(flat) spacing: u32,
}

fn tile_height(tile: TileIn, p: vec2<i32>) -> i32 {
    return textureLoad(tile_heights, tile.atlas + p * CELL_SAMPLES, 0).x;
}

// Height over the eye's nearest height unit.
fn relative_height(tile: TileIn, p: vec2<i32>) -> f32 {
    return f32(tile_height(tile, p) - terrain.eye_height);
}

// A point of the plane, relative to the eye.
fn across(tile: TileIn, p: vec2<i32>) -> vec2<f32> {
    return vec2<f32>(tile.from_eye + (p << vec2(tile.spacing_regions.x))) * terrain.unit - terrain.eye_fraction.xz;
}

// Morph distances of a point.
fn morph_at(tile: TileIn, at: vec2<f32>) -> vec2<f32> {
    var morph = tile.morph;
    var left = tile.spacing_regions.y;
    let grown = DIAGONAL * f32((1u << tile.spacing_regions.x) - 1u) * terrain.unit;
    while (left != 0u) {
        let r = firstTrailingBit(left);
        left &= left - 1u;
        let line = regions.lines[r];
        let along = line.zw - line.xy;
        let share = clamp(dot(at - line.xy, along) / max(dot(along, along), 1e-30), 0.0, 1.0);
        let beyond = length(at - line.xy - share * along) - regions.radii[r / 4u][r % 4u] - grown;
        let two = regions.morph[r * 16u + tile.spacing_regions.x / 2u];
        let own = select(two.xy, two.zw, (tile.spacing_regions.x & 1u) == 1u);
        morph = max(morph, own - FALLOFF * max(beyond, 0.0));
    }
    return morph;
}

struct Placed {
    position: vec3<f32>,
    point: vec2<i32>, // of the tile
    coarser: f32,
    height: f32,
}

fn place(tile: TileIn) -> Placed {
    let row = i32(tile.vertex) / (TILE_CELLS + 1);
    var p = vec2(i32(tile.vertex) - row * (TILE_CELLS + 1), row);
    let flat_position = across(tile, p);
    let d = length(vec3(flat_position, terrain.above));
    let morph = morph_at(tile, flat_position);
    let weight = clamp((d - morph.x) / (morph.y - morph.x), 0.0, 1.0);

    // An odd point lies in the middle of an edge of the coarser triangulation: along a side or along the diagonal.
    // On the outline, where a coarser tile may begin, a point that has arrived there goes on to the edge's end, because a
    // point within a neighbour's edge would leave gaps of a rounding error's size.
    let odd = p & vec2(1);
    let on_side = (p == vec2(0)) | (p == vec2(TILE_CELLS));
    if (weight >= 1.0 && ((on_side.x && odd.y == 1) || (on_side.y && odd.x == 1))) {
        p -= odd;
        let end = relative_height(tile, p);
        let at = across(tile, p);
        return Placed(
            vec3(at.x, end * terrain.height_unit - terrain.eye_fraction.y, at.y),
            p,
            1.0,
            f32(tile_height(tile, p)) * terrain.height_unit,
        );
    }
    let fine = relative_height(tile, p);
    if (weight <= 0.0) {
        return Placed(
            vec3(flat_position.x, fine * terrain.height_unit - terrain.eye_fraction.y, flat_position.y),
            p,
            0.0,
            (fine + f32(terrain.eye_height)) * terrain.height_unit,
        );
    }
    let coarse = 0.5 * (relative_height(tile, p - odd) + relative_height(tile, p + odd));
    let h = mix(fine, coarse, weight);
    return Placed(
        vec3(flat_position.x, h * terrain.height_unit - terrain.eye_fraction.y, flat_position.y),
        p,
        weight,
        (h + f32(terrain.eye_height)) * terrain.height_unit,
    );
}

fn clip_position(world: vec3<f32>) -> vec4<f32> {
    return frame.clip_from_view * vec4((frame.view_from_world * vec4(world, 0.0)).xyz, 1.0);
}

@vertex
fn vs_terrain(tile: TileIn) -> Ground {
    let placed = place(tile);
    var out: Ground;
    out.position = placed.position;
    out.clip = clip_position(placed.position);
    out.sample = vec2<f32>(tile.atlas + placed.point * CELL_SAMPLES) + 0.5;
    out.coarser = placed.coarser;
    out.height = placed.height;
    out.spacing = tile.spacing_regions.x;
    return out;
}

// Weights of sand, grass, hill and snow; their sum is 1. Between zones one fades into the next; where the ground is
// steep, neither grass nor snow nor sand stays and the hill's rock shows.
fn zone_weights(height: f32, up: f32) -> vec4<f32> {
    let half_width = terrain.zones.w;
    let grass = smoothstep(terrain.zones.x - half_width, terrain.zones.x + half_width, height);
    // Upper zones have no sharp border such as a shore.
    let hill = smoothstep(terrain.zones.y - 2.5 * half_width, terrain.zones.y + 2.5 * half_width, height);
    let snow = smoothstep(terrain.zones.z - 2.5 * half_width, terrain.zones.z + 2.5 * half_width, height);
    let by_height = vec4(1.0 - grass, grass * (1.0 - hill), grass * hill * (1.0 - snow), grass * hill * snow);
    let steep = 1.0 - smoothstep(0.72, 0.86, up);
    let weights = mix(by_height, vec4(0.0, 0.0, 1.0, 0.0), steep);
    return weights / dot(weights, vec4(1.0));
}

// Of the layers' relief: blades of grass lie close.
const DEPTHS: vec4<f32> = vec4(1.0, 0.2, 1.0, 1.0);

// Relief of the ground: linear search and bisection as in relief.wgsl, over the layer of largest weight. Returns the
// shift in the plane, world units.
fn ground_relief(start: vec2<f32>, layer: i32, depth: f32, view: vec3<f32>, normal: vec3<f32>, lod: f32) -> vec2<f32> {
    let cosine = max(-dot(view, normal), 0.15);
    // Along the surface; its tilt is small where relief is near enough to be seen.
    let tangent = view - normal * dot(view, normal);
    let span = tangent.xz * (depth / cosine);
    // 20 and 8 of 48: its relief is shallow.
    let steps = ceil(mix(frame.relief_steps * 5.0 / 12.0, frame.relief_steps / 6.0, cosine));
    var below = 1.0;
    for (var i = 1.0; i < steps; i += 1.0) {
        let t = i / steps;
        if (t >= 1.0 - layer_height(near_uv(start + span * t), layer, lod)) {
            below = t;
            break;
        }
    }
    var over = max(below - 1.0 / steps, 0.0);
    for (var i = 0; i < 5; i++) {
        let middle = 0.5 * (over + below);
        if (middle >= 1.0 - layer_height(near_uv(start + span * middle), layer, lod)) {
            below = middle;
        } else {
            over = middle;
        }
    }
    return span * (0.5 * (over + below));
}

@fragment
fn fs_terrain(g: Ground) -> GBuffer {
    let start = g.position.xz;
    // Derivatives first: they need uniform control flow.
    let dx = dpdx(start);
    let dy = dpdy(start);
    let dzy_x = dpdx(g.position.zy);
    let dzy_y = dpdy(g.position.zy);
    let dxy_x = dpdx(g.position.xy);
    let dxy_y = dpdy(g.position.xy);
    let distance = max(length(g.position), 1e-30);
    let view = g.position / distance;
    let sampled = textureSampleLevel(slopes, layer_sampler, g.sample / vec2<f32>(textureDimensions(slopes)), 0.0);
    // A sample of the finest spacing is half a unit too.
    let run = terrain.unit * exp2(f32(g.spacing)) / f32(CELL_SAMPLES);
    let slope = mix(sampled.xy, sampled.zw, g.coarser) * (SLOPE_UNIT * terrain.height_unit / run);
    let normal_of_surface = normalize(vec3(-slope.x, 1.0, -slope.y));
    var normal = normal_of_surface;

    // Borders of zones wander with the far scale's heights, so that they do not follow a contour line.
    let far_x = turned(dx) / terrain.periods.y * 0.25;
    let far_y = turned(dy) / terrain.periods.y * 0.25;
    let blotch = textureSampleGrad(layers, layer_sampler, far_uv(start) * 0.25, 1, far_x, far_y).a;
    let broad = textureSampleLevel(layers, layer_sampler, far_uv(start) / 64.0, 3, 2.0).a - 0.5;
    let higher = clamp((g.height - terrain.zones.x) / (terrain.zones.y - terrain.zones.x) - 0.2, 0.0, 1.0);
    let wander = (blotch - 0.5 + 6.0 * broad * higher) * terrain.zones.w;
    let weights = zone_weights(g.height + wander, normal.y);

    var at = start;
    if (RELIEF) {
        let px = terrain.relief_depth * frame.scale_px / distance;
        let depth = terrain.relief_depth * smoothstep(0.5, 1.5, px);
        if (depth > 0.0) {
            var layer = 0;
            var most = weights.x;
            if (weights.y > most) { layer = 1; most = weights.y; }
            if (weights.z > most) { layer = 2; most = weights.z; }
            if (weights.w > most) { layer = 3; most = weights.w; }
            let size = f32(textureDimensions(layers).x);
            let rho = max(length(dx), length(dy)) / terrain.periods.x * size;
            let lod = max(log2(max(rho, 1e-6)), 0.0);
            let strength = depth * most * DEPTHS[layer];
            at = start + ground_relief(start, layer, strength, view, normal, lod);
            let texel = exp2(lod) / size;
            let uv = near_uv(at);
            let du = layer_height(uv + vec2(texel, 0.0), layer, lod) - layer_height(uv - vec2(texel, 0.0), layer, lod);
            let dv = layer_height(uv + vec2(0.0, texel), layer, lod) - layer_height(uv - vec2(0.0, texel), layer, lod);
            let bump = vec2(du, dv) * (strength / (2.0 * texel * terrain.periods.x));
            normal = normalize(normal - vec3(bump.x, 0.0, bump.y));
        }
    }

    // Steep ground is seen from the side too.
    let steep = smoothstep(0.82, 0.62, normal_of_surface.y);
    let sides = normal_of_surface * normal_of_surface;
    let ways = mix(vec3(0.0, 1.0, 0.0), sides / dot(sides, vec3(1.0)), steep);
    // Bit mask of layers and planes with weight: most terrain has one layer on one plane, and a loop over bits is
    // short where software drivers would execute both sides of a branch.
    var left = 0u;
    for (var bit = 0u; bit < 12u; bit++) {
        left |= select(0u, 1u << bit, weights[bit / 3u] > 0.004 && ways[bit % 3u] > 0.01);
    }
    var sum = vec4(0.0);
    var bump = vec2(0.0);
    while (left != 0u) {
        let bit = firstTrailingBit(left);
        left &= left - 1u;
        let layer = i32(bit / 3u);
        var p = Plane(near_uv(at), far_uv(at), dx, dy);
        if (bit % 3u == 0u) {
            let beside = vec2(terrain.eye_in_near.y, terrain.eye_up.x);
            p = plane(g.position.zy + beside, g.position.zy + vec2(terrain.eye_in_far.y, terrain.eye_up.y), dzy_x, dzy_y);
        }
        if (bit % 3u == 2u) {
            let beside = vec2(terrain.eye_in_near.x, terrain.eye_up.x);
            p = plane(g.position.xy + beside, g.position.xy + vec2(terrain.eye_in_far.x, terrain.eye_up.y), dxy_x, dxy_y);
        }
        let covered = ground(layer, p, blotch);
        // What stands higher covers what lies between.
        let share = weights[layer] * ways[bit % 3u];
        sum += share * (0.2 + covered.height) * vec4(covered.colour, 1.0);
        bump += select(0.0, share * DEPTHS[layer], bit % 3u == 1u) * covered.slope;
    }
    var albedo = sum.rgb / max(sum.a, 1e-6) * (0.8 + 0.4 * blotch);
    if (RELIEF) {
        normal = normalize(normal - vec3(bump.x, 0.0, bump.y));
    }
    if (frame.shade == 1u) {
        albedo = level_colour(g.spacing);
    }
    return g_buffer(normal, mix(0.95, 0.6, weights.w), 1.0, albedo, 0.0, false);
}

// Into a map of shadows.
@vertex
fn vs_terrain_caster(tile: TileIn) -> @builtin(position) vec4<f32> {
    return clip_position(place(tile).position);
}

// Edges, counted, moved towards the eye as in mesh_vertex.wgsl.
@vertex
fn vs_terrain_wire(tile: TileIn) -> @builtin(position) vec4<f32> {
    var clip = clip_position(place(tile).position);
    clip.z *= 1.0 + WIRE_AHEAD * frame.to_sun.w;
    return clip;
}

@fragment
fn fs_terrain_wire() -> @location(0) vec4<f32> {
    return vec4(EDGE, 0.0, 0.0, 1.0);
}
