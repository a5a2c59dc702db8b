// Vertex stage of PN triangles: a grid vertex on a triangle of a list (pn_list.wgsl).

struct Job {
    draws: array<u32, 35>,
    starts: array<u32, 7>,
}

struct Listed {
    face: u32,
    instance: u32,
    steps: u32,
}

@group(3) @binding(0) var<storage, read> job: Job;
@group(3) @binding(4) var<storage, read> listed: array<Listed>;

struct VertexIn {
    // Numbers of pieces from the edges across corners B and C, and the grid's step.
    @location(0) grid: vec4<u32>,
    @builtin(instance_index) number: u32,
}

// A vertex on its triangle.
struct PatchPoint {
    face: u32,
    instance: u32,
    // Barycentric.
    weights: vec3<f32>,
}

// The nearest end of an edge's pieces to one of the grid's, which are as fine or finer.
fn snapped(piece: u32, grid: u32, edge: u32) -> u32 {
    let width = 1u << (grid - edge);
    return (piece + width / 2u) / width * width;
}

fn patch_point(v: VertexIn) -> PatchPoint {
    let step = v.grid.z;
    let on = listed[job.starts[step] + v.number];
    let pieces = 1u << step;
    var w = vec3(pieces - v.grid.x - v.grid.y, v.grid.x, v.grid.y);
    if (w.z == 0u) {
        w.y = snapped(w.y, step, on.steps & 7u);
        w.x = pieces - w.y;
    } else if (w.x == 0u) {
        w.z = snapped(w.z, step, (on.steps >> 3u) & 7u);
        w.y = pieces - w.z;
    } else if (w.y == 0u) {
        w.x = snapped(w.x, step, (on.steps >> 6u) & 7u);
        w.z = pieces - w.x;
    }
    return PatchPoint(on.face, on.instance, vec3<f32>(w) / f32(pieces));
}

// The corner that a vertex of a grid of one piece is.
fn own_slot(v: VertexIn, face: u32) -> u32 {
    return faces[face * 3u + v.grid.x + 2u * v.grid.y];
}

// A place on a patch, relative to the asset's origin. On an edge only that edge decides.
fn bent(c: array<Corner, 3>, w: vec3<f32>) -> vec3<f32> {
    if (w.z == 0.0) {
        return on_edge(c[0], c[1], w.y);
    }
    if (w.x == 0.0) {
        return on_edge(c[1], c[2], w.z);
    }
    if (w.y == 0.0) {
        return on_edge(c[2], c[0], w.x);
    }
    return on_patch(c, w);
}

// Where a vertex is at a time, relative to the asset's origin. Most triangles are of one piece, which needs no patch.
fn local_at(v: VertexIn, at: PatchPoint, time_s: f32) -> vec3<f32> {
    if (v.grid.z == 0u) {
        return corner(own_slot(v, at.face), time_s).position;
    }
    return bent(corners_of(at.face, time_s), at.weights);
}

fn placed(v: VertexIn, at: PatchPoint) -> vec3<f32> {
    let local = local_at(v, at, frame.time_s);
    return in_world(local, instances[INSTANCE_VECTORS * at.instance], instances[INSTANCE_VECTORS * at.instance + 1u]);
}

fn uv_of(slot: u32) -> vec2<f32> {
    let at = slot * VERTEX_WORDS + 8u;
    return vec2(bitcast<f32>(vertices[at]), bitcast<f32>(vertices[at + 1u]));
}

fn second_uv_of(slot: u32) -> vec2<f32> {
    return attributes_of(vertices[slot * VERTEX_WORDS + 7u]).second_uv;
}

fn second_uv_at(slots: vec3<u32>, w: vec3<f32>) -> vec2<f32> {
    return second_uv_of(slots.x) * w.x + second_uv_of(slots.y) * w.y + second_uv_of(slots.z) * w.z;
}

fn colour_of(slot: u32) -> vec4<f32> {
    let colour = unpack4x8unorm(vertices[slot * VERTEX_WORDS + 12u]);
    return vec4(linear_from_srgb(colour.rgb), colour.a);
}

fn slots_of(face: u32) -> vec3<u32> {
    return vec3(faces[face * 3u], faces[face * 3u + 1u], faces[face * 3u + 2u]);
}

fn uv_at(slots: vec3<u32>, w: vec3<f32>) -> vec2<f32> {
    return uv_of(slots.x) * w.x + uv_of(slots.y) * w.y + uv_of(slots.z) * w.z;
}

@vertex
fn vs_surface(v: VertexIn) -> Surface {
    let at = patch_point(v);
    let w = at.weights;
    let slots = slots_of(at.face);
    var local: vec3<f32>;
    var normal: vec3<f32>;
    var uv: vec2<f32>;
    var out: Surface;
    if (v.grid.z == 0u) {
        let slot = own_slot(v, at.face);
        let own = corner(slot, frame.time_s);
        local = own.position;
        normal = own.normal;
        uv = uv_of(slot);
        out.second_uv = second_uv_of(slot);
        out.colour = colour_of(slot);
    } else {
        let c = corners_of(at.face, frame.time_s);
        local = bent(c, w);
        normal = normal_on_patch(c, w);
        uv = uv_at(slots, w);
        out.second_uv = second_uv_at(slots, w);
        out.colour = colour_of(slots.x) * w.x + colour_of(slots.y) * w.y + colour_of(slots.z) * w.z;
    }
    let rotation = instances[INSTANCE_VECTORS * at.instance + 1u];
    out.position = in_world(local, instances[INSTANCE_VECTORS * at.instance], rotation);
    out.clip = clip_position(out.position);
    out.normal = rotate(rotation, normal);
    out.uv = vec2(uv.x, 1.0 - uv.y);
    out.level = vertices[slots.x * VERTEX_WORDS + 7u] & 255u;
    out.tint = 0u; // parts' states are for flat triangles
    return out;
}

// Shadow caster: `frame` then holds the sun's view.
@vertex
fn vs_caster(v: VertexIn) -> @builtin(position) vec4<f32> {
    return clip_position(placed(v, patch_point(v)));
}

@vertex
fn vs_pierced(v: VertexIn) -> Pierced {
    let at = patch_point(v);
    let slots = slots_of(at.face);
    let w = at.weights;
    let uv = uv_at(slots, w);
    let opacity = vec3(colour_of(slots.x).a, colour_of(slots.y).a, colour_of(slots.z).a);
    return Pierced(clip_position(placed(v, at)), vec2(uv.x, 1.0 - uv.y), dot(opacity, w), second_uv_at(slots, w));
}

// Edges of the grid, as those of meshes.
@vertex
fn vs_wire(v: VertexIn) -> @builtin(position) vec4<f32> {
    var clip = clip_position(placed(v, patch_point(v)));
    clip.z *= 1.0 + WIRE_AHEAD * frame.to_sun.w;
    return clip;
}
