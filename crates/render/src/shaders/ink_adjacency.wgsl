// Edge adjacency of a mesh: hash tables of positions and edges with open addressing (Knuth, "The art of computer
// programming" 3, section 6.4), filled concurrently. Rebuilt when a mesh has changed.
//
// Wedges of one position count as one vertex, so attribute seams are no borders. The sides of an edge are linked in a
// ring; an edge of two triangles has a ring of two, a border a ring of one.

struct Job {
    vertices: u32, // slots
    first: u32, // side of all that a part's begin with
    sides: u32, // of the part, three a face slot
    all: u32, // of all parts
    mask: u32, // cells of the tables, a power of two, less one
}

@group(0) @binding(0) var<uniform> job: Job;
// `PackedVertex`, 13 words a slot; wedge slots of one part, three a face.
@group(0) @binding(1) var<storage, read> vertices: array<u32>;
@group(0) @binding(2) var<storage, read> faces: array<u32>;
// Of each side the vertex that it begins at.
@group(0) @binding(3) var<storage, read_write> corners: array<u32>;
// Of each side the next one of its edge.
@group(0) @binding(4) var<storage, read_write> rings: array<atomic<u32>>;
// Of each cell who took it, one more; and the largest complement of a vertex there, or the last side that came, one more.
@group(0) @binding(5) var<storage, read_write> owners: array<atomic<u32>>;
@group(0) @binding(6) var<storage, read_write> heads: array<atomic<u32>>;

const VERTEX_WORDS: u32 = 13u;
// A side of a face that covers no pixel, or that found no cell.
const NONE: u32 = 0xffffffffu;
// Cells that are looked at, so that work is bounded whatever the places are.
const PROBES: u32 = 256u;

// The finaliser of MurmurHash3 (Appleby 2011).
fn scrambled(word: u32) -> u32 {
    var x = word;
    x = (x ^ (x >> 16u)) * 0x85ebca6bu;
    x = (x ^ (x >> 13u)) * 0xc2b2ae35u;
    return x ^ (x >> 16u);
}

// A place by its bits; -0 is 0.
fn place(slot: u32) -> vec3<u32> {
    let at = slot * VERTEX_WORDS;
    let bits = vec3(vertices[at], vertices[at + 1u], vertices[at + 2u]);
    return select(bits, vec3(0u), bits == vec3(0x80000000u));
}

fn cell_of_place(at: vec3<u32>) -> u32 {
    return scrambled(at.x ^ scrambled(at.y ^ scrambled(at.z + 0x9e3779b9u))) & job.mask;
}

// Claims a free cell; returns its owner.
fn claim(cell: u32, by: u32) -> u32 {
    loop {
        let was = atomicCompareExchangeWeak(&owners[cell], 0u, by);
        if (was.exchanged) {
            return by;
        }
        if (was.old_value != 0u) {
            return was.old_value;
        }
    }
    return by;
}

fn next_side(side: u32) -> u32 {
    return select(side + 1u, side - 2u, side % 3u == 2u);
}

// The ends of a side's edge, the smaller first.
fn ends(side: u32) -> vec2<u32> {
    let a = corners[side];
    let b = corners[next_side(side)];
    return vec2(min(a, b), max(a, b));
}

fn cell_of_edge(edge: vec2<u32>) -> u32 {
    return scrambled(edge.x ^ scrambled(edge.y + 0x9e3779b9u)) & job.mask;
}

@compute @workgroup_size(256)
fn cs_clear(@builtin(global_invocation_id) id: vec3<u32>) {
    for (var cell = id.x; cell <= job.mask; cell += 65535u * 256u) {
        atomicStore(&owners[cell], 0u);
        atomicStore(&heads[cell], 0u);
    }
}

@compute @workgroup_size(256)
fn cs_places(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if (slot >= job.vertices) {
        return;
    }
    let at = place(slot);
    var cell = cell_of_place(at);
    for (var probe = 0u; probe < PROBES; probe++) {
        let owner = claim(cell, slot + 1u);
        if (owner == slot + 1u || all(place(owner - 1u) == at)) {
            // The least of them stands for all, whoever came first.
            atomicMax(&heads[cell], ~slot);
            return;
        }
        cell = (cell + 1u) & job.mask;
    }
}

// The wedge that stands for all of its place.
fn vertex_of(slot: u32) -> u32 {
    let at = place(slot);
    var cell = cell_of_place(at);
    for (var probe = 0u; probe < PROBES; probe++) {
        let owner = atomicLoad(&owners[cell]);
        if (owner == 0u) {
            break;
        }
        if (all(place(owner - 1u) == at)) {
            return ~atomicLoad(&heads[cell]);
        }
        cell = (cell + 1u) & job.mask;
    }
    return slot;
}

@compute @workgroup_size(256)
fn cs_corners(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= job.sides) {
        return;
    }
    let slot = faces[id.x];
    // Of what is not there nothing is known.
    corners[job.first + id.x] = select(NONE, vertex_of(slot), slot < job.vertices);
}

// Whether a side's face is a triangle.
fn is_side(side: u32) -> bool {
    let b = next_side(side);
    let abc = vec3(corners[side], corners[b], corners[next_side(b)]);
    return all(abc != abc.yzx) && all(abc != vec3(NONE));
}

@compute @workgroup_size(256)
fn cs_edges(@builtin(global_invocation_id) id: vec3<u32>) {
    let side = id.x;
    if (side >= job.all) {
        return;
    }
    atomicStore(&rings[side], NONE);
    if (!is_side(side)) {
        return;
    }
    let edge = ends(side);
    var cell = cell_of_edge(edge);
    for (var probe = 0u; probe < PROBES; probe++) {
        let owner = claim(cell, side + 1u);
        if (owner == side + 1u || all(ends(owner - 1u) == edge)) {
            // A list, of which the one that came first is the end.
            atomicStore(&rings[side], atomicExchange(&heads[cell], side + 1u));
            return;
        }
        cell = (cell + 1u) & job.mask;
    }
}

// From lists to rings: what follows is no longer one more, and the end leads to the head.
@compute @workgroup_size(256)
fn cs_rings(@builtin(global_invocation_id) id: vec3<u32>) {
    let side = id.x;
    if (side >= job.all) {
        return;
    }
    let after = atomicLoad(&rings[side]);
    if (after == NONE) {
        return;
    }
    if (after != 0u) {
        atomicStore(&rings[side], after - 1u);
        return;
    }
    let edge = ends(side);
    var cell = cell_of_edge(edge);
    for (var probe = 0u; probe < PROBES; probe++) {
        let owner = atomicLoad(&owners[cell]);
        if (owner != 0u && all(ends(owner - 1u) == edge)) {
            atomicStore(&rings[side], atomicLoad(&heads[cell]) - 1u);
            return;
        }
        cell = (cell + 1u) & job.mask;
    }
}
