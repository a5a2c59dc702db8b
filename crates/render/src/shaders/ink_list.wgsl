// Strokes of a frame: the edges that are contours, borders or creases as the eye sees them, cut to the view.

struct Job {
    sides: u32,
    first_instance: u32,
    instances: u32,
    most: u32, // strokes
    crease: f32, // cosine
}

struct Stroke {
    // Pixels, stored depth; of the start, half the most that it may be wide.
    start: vec4<f32>,
    end: vec4<f32>,
}

struct Drawn {
    vertices: u32,
    strokes: atomic<u32>,
    first_vertex: u32,
    first_stroke: u32,
}

@group(1) @binding(0) var<uniform> job: Job;
@group(1) @binding(1) var<storage, read> vertices: array<u32>;
@group(1) @binding(2) var<storage, read> corners: array<u32>;
@group(1) @binding(3) var<storage, read> rings: array<u32>;
// `InstanceRaw`.
@group(1) @binding(4) var<storage, read> instances: array<vec4<f32>>;
@group(1) @binding(5) var<storage, read_write> drawn: Drawn;
@group(1) @binding(6) var<storage, read_write> strokes: array<Stroke>;

const VERTEX_WORDS: u32 = 13u;
const NONE: u32 = 0xffffffffu;
// Triangles of one edge that are looked at; edges of more are not drawn.
const MOST_SIDES: u32 = 16u;
// Pixels beyond the picture at which strokes are cut.
const MARGIN_PX: f32 = 64.0;
// More pixels than any stroke is wide.
const UNBOUND: f32 = 1e6;

fn next_side(side: u32) -> u32 {
    return select(side + 1u, side - 2u, side % 3u == 2u);
}

fn place_word(at: u32) -> vec3<f32> {
    return vec3(bitcast<f32>(vertices[at]), bitcast<f32>(vertices[at + 1u]), bitcast<f32>(vertices[at + 2u]));
}

// Where a vertex is now, relative to the asset's origin.
fn local(slot: u32) -> vec3<f32> {
    let at = slot * VERTEX_WORDS;
    let weight = morph_weight(frame.time_s - bitcast<f32>(vertices[at + 3u]));
    return mix(place_word(at + 4u), place_word(at), weight);
}

// Some order of places, so that it does not matter whose side an edge is.
fn is_before(a: vec3<f32>, b: vec3<f32>) -> bool {
    return a.x < b.x || (a.x == b.x && (a.y < b.y || (a.y == b.y && a.z < b.z)));
}

// The stretch of a segment, 0 to 1, that lies where a plane's distance is not below 0.
fn cut(stretch: vec2<f32>, start: f32, end: f32) -> vec2<f32> {
    if (start < 0.0 && end < 0.0) {
        return vec2(1.0, 0.0);
    }
    let at = start / (start - end);
    return vec2(
        select(stretch.x, max(stretch.x, at), start < 0.0),
        select(stretch.y, min(stretch.y, at), end < 0.0),
    );
}

fn in_picture(clip: vec4<f32>) -> vec4<f32> {
    let ndc = clip.xy / clip.w;
    return vec4((ndc * vec2(0.5, -0.5) + 0.5) * frame.size_px, clip.z / clip.w, 0.0);
}

fn add(from_clip: vec4<f32>, to_clip: vec4<f32>, half_room: f32) {
    var stretch = vec2(0.0, 1.0);
    stretch = cut(stretch, from_clip.w - from_clip.z, to_clip.w - to_clip.z);
    let margin = 1.0 + 2.0 * MARGIN_PX / frame.size_px;
    let from_side = margin * from_clip.w;
    let to_side = margin * to_clip.w;
    stretch = cut(stretch, from_side.x - from_clip.x, to_side.x - to_clip.x);
    stretch = cut(stretch, from_side.x + from_clip.x, to_side.x + to_clip.x);
    stretch = cut(stretch, from_side.y - from_clip.y, to_side.y - to_clip.y);
    stretch = cut(stretch, from_side.y + from_clip.y, to_side.y + to_clip.y);
    if (!(stretch.x <= stretch.y)) {
        return;
    }
    let start = in_picture(mix(from_clip, to_clip, stretch.x));
    let end = in_picture(mix(from_clip, to_clip, stretch.y));
    // What is no number is nowhere.
    let most = 2.0 * frame.size_px + 2.0 * MARGIN_PX;
    if (!(all(abs(start.xy) < most) && all(abs(end.xy) < most) && start.z > 0.0 && end.z > 0.0)) {
        return;
    }
    let number = atomicAdd(&drawn.strokes, 1u);
    if (number < job.most) {
        strokes[number] = Stroke(vec4(start.xyz, half_room), end);
    }
}

// How high a triangle looks over its edge, in pixels; where it reaches behind the eye, as high as may be.
fn height_px(from_clip: vec4<f32>, to_clip: vec4<f32>, third: vec3<f32>) -> f32 {
    let third_clip = clip_position(third);
    if (min(min(from_clip.w - from_clip.z, to_clip.w - to_clip.z), third_clip.w - third_clip.z) <= 0.0) {
        return UNBOUND;
    }
    let start = in_picture(from_clip).xy;
    let along = in_picture(to_clip).xy - start;
    let across = in_picture(third_clip).xy - start;
    let height = abs(along.x * across.y - along.y * across.x) / length(along);
    return select(UNBOUND, height, height < UNBOUND);
}

@compute @workgroup_size(256)
fn cs_strokes(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= job.sides * job.instances) {
        return;
    }
    let side = id.x % job.sides;
    var other = rings[side];
    // The least of an edge's sides speaks for it.
    if (other == NONE || other < side) {
        return;
    }
    let instance = job.first_instance + id.x / job.sides;
    let offset_scale = instances[INSTANCE_VECTORS * instance];
    let rotation = instances[INSTANCE_VECTORS * instance + 1u];
    let next = next_side(side);
    var a = local(corners[side]);
    var b = local(corners[next]);
    if (is_before(b, a)) {
        let least = b;
        b = a;
        a = least;
    }
    let from_eye = in_world(a, offset_scale, rotation);
    // Differences are those of the asset's own coordinates, which are exact far from zero too; in units of the edge, so that
    // squares of none are too small.
    let longest = max(max(abs(b.x - a.x), abs(b.y - a.y)), abs(b.z - a.z));
    let from_clip = clip_position(from_eye);
    let to_clip = clip_position(in_world(b, offset_scale, rotation));
    let scale = 1.0 / max(longest, 1e-37);
    let along = (b - a) * scale;
    let first = local(corners[next_side(next)]);
    let normal = cross(along, (first - a) * scale);
    var highest = height_px(from_clip, to_clip, in_world(first, offset_scale, rotation));
    var found = side_of(from_eye, along, rotate(rotation, normal));
    let more = other != side && rings[other] != side;
    for (var count = 1u; other != side; count++) {
        if (other < side || count == MOST_SIDES) {
            return;
        }
        let third = local(corners[next_side(next_side(other))]);
        let its = cross(along, (third - a) * scale);
        found |= side_of(from_eye, along, rotate(rotation, its));
        found |= select(0u, CREASE, is_crease(normal, its, job.crease, more));
        highest = max(highest, height_px(from_clip, to_clip, in_world(third, offset_scale, rotation)));
        other = rings[other];
    }
    if (is_stroke(found)) {
        add(from_clip, to_clip, select(0.5 * CREASE_SHARE * highest, UNBOUND, is_contour(found)));
    }
}

// No more are drawn than there is room for.
@compute @workgroup_size(1)
fn cs_bound() {
    atomicMin(&drawn.strokes, job.most);
}
