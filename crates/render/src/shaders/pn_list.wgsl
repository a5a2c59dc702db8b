// Tessellation levels of edges, and lists of triangles by their finest edge, each of which is one draw of one grid.
// Lists keep the order of instances and faces, independent of scheduling on the device.

// Steps of lists: 1, 2, 4, … 64 pieces.
const STEPS: u32 = 7u;
const GROUP: u32 = 64u;
// A face slot that holds no triangle.
const NONE: u32 = 7u;

struct Job {
    // Of each step: indices, instances, first index, base vertex, first instance.
    draws: array<u32, 35>,
    starts: array<u32, 7>,
    faces: u32,
    first_instance: u32,
    instances: u32,
    groups: u32,
    most: u32, // step
    error_px: f32,
    in_view: u32, // 1: what lies out of the frame's view is left out
}

struct Listed {
    face: u32,
    instance: u32,
    steps: u32, // of edges AB, BC, CA, three bits each
}

@group(3) @binding(0) var<storage, read_write> job: Job;
@group(3) @binding(4) var<storage, read_write> listed: array<Listed>;
// Of each triangle the step of its list, and from bit 4 on those of its edges.
@group(3) @binding(5) var<storage, read_write> steps_of: array<u32>;
// Of each group and step how many there are, then how many there are before.
@group(3) @binding(6) var<storage, read_write> counts: array<u32>;

// The step of an edge: the least power of two of pieces whose chords are nowhere further off the curve than allowed, at
// the nearer end's distance from the eye. A cubic is off its chord by |C''| / 8 n² at most; of its second derivative, which
// is linear, the ends decide.
fn edge_step(a: Corner, b: Corner, instance: u32) -> u32 {
    var first = a;
    var second = b;
    if (is_before(b.position, a.position)) {
        first = b;
        second = a;
    }
    let o = bow(first, second.position);
    let p = bow(second, first.position);
    let bend = 6.0 * max(length(p - 2.0 * o), length(o - 2.0 * p));
    let offset_scale = instances[INSTANCE_VECTORS * instance];
    let rotation = instances[INSTANCE_VECTORS * instance + 1u];
    let near = length(in_world(first.position, offset_scale, rotation));
    let distance = max(min(near, length(in_world(second.position, offset_scale, rotation))), 1e-30);
    let allowed = 8.0 * job.error_px * distance / (frame.scale_px * abs(offset_scale.w));
    var step = 0u;
    while (step < job.most && bend > allowed * f32(1u << (2u * step))) {
        step++;
    }
    return step;
}

// Whether a patch lies wholly beyond one side of the view, or behind the eye. Its control points hold it; those of edges lie
// off the triangle by their bows, the middle one by a quarter of the six's sum.
fn is_out_of_view(c: array<Corner, 3>, instance: u32) -> bool {
    let most = max(
        max(max(length(bow(c[0], c[1].position)), length(bow(c[1], c[0].position))),
            max(length(bow(c[1], c[2].position)), length(bow(c[2], c[1].position)))),
        max(length(bow(c[2], c[0].position)), length(bow(c[0], c[2].position))));
    let offset_scale = instances[INSTANCE_VECTORS * instance];
    let rotation = instances[INSTANCE_VECTORS * instance + 1u];
    let margin = 1.5 * most * abs(offset_scale.w);
    // A pixel more, since frames look anywhere in theirs.
    let tangent = frame.tan_half_fov * (1.0 + 2.0 / frame.size_px);
    let across = inverseSqrt(1.0 + tangent * tangent);
    var beyond = vec4(true);
    var behind = true;
    for (var i = 0u; i < 3u; i++) {
        let p = (frame.view_from_world * vec4(in_world(c[i].position, offset_scale, rotation), 0.0)).xyz;
        // Distances off the planes right, left, top and bottom.
        let off = vec4(p.x, -p.x, p.y, -p.y) + p.z * tangent.xxyy;
        beyond = beyond & (off * across.xxyy > vec4(margin));
        behind = behind && p.z > margin;
    }
    return any(beyond) || behind;
}

var<workgroup> in_group: array<atomic<u32>, 8>;

@compute @workgroup_size(64)
fn cs_measure(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let number = group.x * GROUP + local;
    var found = NONE;
    if (number < job.faces * job.instances) {
        let face = number % job.faces;
        let instance = job.first_instance + number / job.faces;
        let slots = vec3(faces[face * 3u], faces[face * 3u + 1u], faces[face * 3u + 2u]);
        if (slots.x != slots.y && slots.y != slots.z && slots.z != slots.x) {
            let c = corners_of(face, frame.time_s);
            if (job.in_view == 0u || !is_out_of_view(c, instance)) {
                let ab = edge_step(c[0], c[1], instance);
                let bc = edge_step(c[1], c[2], instance);
                let ca = edge_step(c[2], c[0], instance);
                found = max(ab, max(bc, ca)) | (ab << 4u) | (bc << 7u) | (ca << 10u);
            }
        }
        steps_of[number] = found;
    }
    atomicAdd(&in_group[found & 7u], 1u);
    workgroupBarrier();
    if (local < STEPS) {
        counts[group.x * STEPS + local] = atomicLoad(&in_group[local]);
    }
}

var<workgroup> totals: array<u32, 7>;

@compute @workgroup_size(7)
fn cs_arrange(@builtin(local_invocation_index) local: u32) {
    var before = 0u;
    for (var group = 0u; group < job.groups; group++) {
        let here = counts[group * STEPS + local];
        counts[group * STEPS + local] = before;
        before += here;
    }
    totals[local] = before;
    workgroupBarrier();
    if (local == 0u) {
        var start = 0u;
        for (var step = 0u; step < STEPS; step++) {
            // Of a grid of n pieces n² triangles, after those of the coarser ones.
            let triangles = 1u << (2u * step);
            job.draws[step * 5u] = 3u * triangles;
            job.draws[step * 5u + 1u] = totals[step];
            job.draws[step * 5u + 2u] = triangles - 1u;
            job.draws[step * 5u + 3u] = 0u;
            job.draws[step * 5u + 4u] = 0u;
            job.starts[step] = start;
            start += totals[step];
        }
    }
}

var<workgroup> found_by: array<u32, 64>;

@compute @workgroup_size(64)
fn cs_list(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let number = group.x * GROUP + local;
    let there = number < job.faces * job.instances;
    var found = NONE;
    if (there) {
        found = steps_of[number];
    }
    let step = found & 7u;
    found_by[local] = step;
    workgroupBarrier();
    if (step == NONE) {
        return;
    }
    var at = job.starts[step] + counts[group.x * STEPS + step];
    for (var i = 0u; i < local; i++) {
        at += u32(found_by[i] == step);
    }
    listed[at] = Listed(number % job.faces, job.first_instance + number / job.faces, found >> 4u);
}
