// PN triangles (Vlachos, Peters, Boyd and Mitchell, "Curved PN triangles", 2001): a triangle as a cubic patch, from its
// corners and their normals alone. CPU reference: cpu_reference/pn_triangles.rs.
//
// Patches are stored as offsets of their control points from the flat triangle's: a flat triangle has none and is
// reproduced exactly.

// `PackedVertex`, 13 words a slot; `InstanceRaw`; wedge slots, three a face.
@group(3) @binding(1) var<storage, read> vertices: array<u32>;
@group(3) @binding(2) var<storage, read> faces: array<u32>;
@group(3) @binding(3) var<storage, read> instances: array<vec4<f32>>;

const VERTEX_WORDS: u32 = 13u;

// A corner of a patch, relative to the asset's origin.
struct Corner {
    position: vec3<f32>,
    normal: vec3<f32>,
    bends: bool, // no crease runs through it
}

fn place_word(at: u32) -> vec3<f32> {
    return vec3(bitcast<f32>(vertices[at]), bitcast<f32>(vertices[at + 1u]), bitcast<f32>(vertices[at + 2u]));
}

// A vertex as a corner, at a time.
fn corner(slot: u32, time_s: f32) -> Corner {
    let at = slot * VERTEX_WORDS;
    let weight = morph_weight(time_s - bitcast<f32>(vertices[at + 3u]));
    let z_and_crease = unpack2x16snorm(vertices[at + 11u]);
    return Corner(
        mix(place_word(at + 4u), place_word(at), weight),
        vec3(unpack2x16snorm(vertices[at + 10u]), z_and_crease.x),
        z_and_crease.y != 0.0,
    );
}

fn corners_of(face: u32, time_s: f32) -> array<Corner, 3> {
    return array<Corner, 3>(
        corner(faces[face * 3u], time_s),
        corner(faces[face * 3u + 1u], time_s),
        corner(faces[face * 3u + 2u], time_s),
    );
}

// How far the control point beside a corner lies off the edge to another: at a third of it, moved into the plane across
// the normal (equation 3 of the paper, less the edge's third). Of the edge's ends alone.
fn bow(from_corner: Corner, to: vec3<f32>) -> vec3<f32> {
    let rise = dot(to - from_corner.position, from_corner.normal);
    return select(vec3(0.0), from_corner.normal * (rise * (-1.0 / 3.0)), from_corner.bends);
}

// Some order of places. Both triangles of an edge reckon from the same end, so that rounding opens no crack.
fn is_before(a: vec3<f32>, b: vec3<f32>) -> bool {
    return a.x < b.x || (a.x == b.x && (a.y < b.y || (a.y == b.y && a.z < b.z)));
}

// A point of an edge's curve, so far from `a` to `b`.
fn on_edge(a: Corner, b: Corner, way: f32) -> vec3<f32> {
    let turned = is_before(b.position, a.position);
    var first = a;
    var second = b;
    var t = way;
    if (turned) {
        first = b;
        second = a;
        t = 1.0 - way;
    }
    let s = 1.0 - t;
    let chord = first.position * s + second.position * t;
    return chord + (bow(first, second.position) * s + bow(second, first.position) * t) * (3.0 * s * t);
}

// A point of a patch by its barycentric coordinates.
fn on_patch(c: array<Corner, 3>, w: vec3<f32>) -> vec3<f32> {
    let ab = bow(c[0], c[1].position);
    let ba = bow(c[1], c[0].position);
    let bc = bow(c[1], c[2].position);
    let cb = bow(c[2], c[1].position);
    let ca = bow(c[2], c[0].position);
    let ac = bow(c[0], c[2].position);
    let flat_place = c[0].position * w.x + c[1].position * w.y + c[2].position * w.z;
    let edges = (ab * w.x + ba * w.y) * (w.x * w.y) + (bc * w.y + cb * w.z) * (w.y * w.z)
        + (ca * w.z + ac * w.x) * (w.z * w.x);
    // b111 = E + (E − V) / 2: half as much again as the six are off on average.
    let middle = (ab + ba + bc + cb + ca + ac) * (1.5 * w.x * w.y * w.z);
    return flat_place + 3.0 * edges + middle;
}

// The normal midway of an edge: both ends', mirrored at the plane across it (n110 of the paper).
fn normal_midway(a: Corner, b: Corner) -> vec3<f32> {
    let along = b.position - a.position;
    let both = a.normal + b.normal;
    let square = dot(along, along);
    let turned = both - along * select(0.0, 2.0 * dot(along, both) / square, square > 0.0);
    let size = length(turned);
    return select(vec3(0.0), turned / size, size > 0.0);
}

// The normal of a patch, not normalised: quadratic, and not the one across the cubic.
fn normal_on_patch(c: array<Corner, 3>, w: vec3<f32>) -> vec3<f32> {
    return c[0].normal * (w.x * w.x) + c[1].normal * (w.y * w.y) + c[2].normal * (w.z * w.z)
        + normal_midway(c[0], c[1]) * (w.x * w.y) + normal_midway(c[1], c[2]) * (w.y * w.z)
        + normal_midway(c[2], c[0]) * (w.z * w.x);
}
