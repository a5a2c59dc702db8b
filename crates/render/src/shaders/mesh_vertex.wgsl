// Vertex stage of flat meshes.

struct VertexIn {
    @location(0) position: vec3<f32>,
    @location(1) birth_s: f32,
    @location(2) morph_from: vec3<f32>,
    @location(3) part_and_level: u32,
    @location(4) uv: vec2<f32>,
    @location(5) normal: vec4<f32>,
    @location(6) colour: vec4<f32>, // sRGB-encoded
    @location(7) offset_scale: vec4<f32>,
    @location(8) rotation: vec4<f32>,
    @location(11) states: u32, // where its parts' states begin; 0: none
}

// States of parts, as part_words.rs writes them: for an instance the number of parts that follow, where the places of
// their moves begin (0: none), where its pose does (0: none), the state of all others, and the states. A texture, since not every device has storage
// buffers in the vertex stage.
@group(1) @binding(7) var part_states: texture_2d<u32>;

const PART_STATES_WIDTH: u32 = 1024u;
const HIDDEN: u32 = 0x80000000u;

fn part_states_at(at: u32) -> u32 {
    return textureLoad(part_states, vec2(at % PART_STATES_WIDTH, at / PART_STATES_WIDTH), 0).x;
}

// Where a vertex's part is in the lists of an instance: the first entry is of all parts that are not listed.
fn part_entry(v: VertexIn, states: u32) -> u32 {
    let own = attributes_of(v.part_and_level);
    let part = select(own.joints, 0u, own.weights != 0u);
    return select(0u, part + 1u, part < part_states_at(states));
}

// Tint of a vertex's part in its low 31 bits, and whether it is hidden.
fn part_state(v: VertexIn) -> u32 {
    if (!STATES || v.states == 0u) {
        return 0u;
    }
    return part_states_at(v.states + 3u + part_entry(v, v.states));
}

// Where the move of a vertex's part is among the states that begin at `states`; 0 if it has none.
fn part_move(v: VertexIn, states: u32) -> u32 {
    if (!STATES || states == 0u) {
        return 0u;
    }
    let moves = part_states_at(states + 1u);
    if (moves == 0u) {
        return 0u;
    }
    return part_states_at(moves + part_entry(v, states));
}

// Four numbers of a move: offset and scale, or its rotation.
fn part_move_at(at: u32) -> vec4<f32> {
    return bitcast<vec4<f32>>(vec4(
        part_states_at(at), part_states_at(at + 1u), part_states_at(at + 2u), part_states_at(at + 3u),
    ));
}

// A place of the asset, relative to its origin, where its part is moved to.
fn part_moved(local: vec3<f32>, move_at: u32) -> vec3<f32> {
    if (move_at == 0u) {
        return local;
    }
    return in_world(local, part_move_at(move_at), part_move_at(move_at + 4u));
}

// An affine map as rows.
struct Rows {
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
}

const STILL: Rows = Rows(vec4(1.0, 0.0, 0.0, 0.0), vec4(0.0, 1.0, 0.0, 0.0), vec4(0.0, 0.0, 1.0, 0.0));

// Where the pose of an instance is among the states that begin at `states`; 0 if it has none.
fn pose_of(states: u32) -> u32 {
    if (!STATES || states == 0u) {
        return 0u;
    }
    return part_states_at(states + 2u);
}

// Linear blend skinning: the mean of the maps of a vertex's joints, by weight. Joints beyond the pose's stand still.
fn blended(v: VertexIn, pose: u32) -> Rows {
    let own = attributes_of(v.part_and_level);
    // Not skinned: all of the first joint.
    let skin = select(vec2(0u, 255u), vec2(own.joints, own.weights), own.weights != 0u);
    let joints = part_states_at(pose);
    var sum = Rows(vec4(0.0), vec4(0.0), vec4(0.0));
    for (var i = 0u; i < 4u; i++) {
        let weight = f32((skin.y >> (8u * i)) & 255u) / 255.0;
        if (weight == 0.0) {
            continue;
        }
        let joint = (skin.x >> (8u * i)) & 255u;
        var map = STILL;
        if (joint < joints) {
            let at = pose + 1u + 12u * joint;
            map = Rows(part_move_at(at), part_move_at(at + 4u), part_move_at(at + 8u));
        }
        sum = Rows(sum.x + weight * map.x, sum.y + weight * map.y, sum.z + weight * map.z);
    }
    return sum;
}

// A place of the asset, relative to its origin, where the vertex's joints take it.
fn posed(local: vec3<f32>, v: VertexIn, states: u32) -> vec3<f32> {
    let pose = pose_of(states);
    if (pose == 0u) {
        return local;
    }
    let map = blended(v, pose);
    let at = vec4(local, 1.0);
    return vec3(dot(map.x, at), dot(map.y, at), dot(map.z, at));
}

// A normal, by the cofactors of the map.
fn posed_normal(normal: vec3<f32>, v: VertexIn) -> vec3<f32> {
    let pose = pose_of(v.states);
    if (pose == 0u) {
        return normal;
    }
    let map = blended(v, pose);
    let turned = vec3(
        dot(cross(map.y.xyz, map.z.xyz), normal),
        dot(cross(map.z.xyz, map.x.xyz), normal),
        dot(cross(map.x.xyz, map.y.xyz), normal),
    );
    let size = length(turned);
    return select(normal, turned / size, size > 0.0);
}

// Outside the picture if the part is hidden: all corners of a face have one part, so that nothing of it is drawn.
fn shown(world: vec3<f32>, state: u32) -> vec4<f32> {
    if ((state & HIDDEN) != 0u) {
        return vec4(2.0, 2.0, 2.0, 1.0);
    }
    return clip_position(world);
}

// Position of a vertex now, world axes, relative to the eye.
fn placed(v: VertexIn) -> vec3<f32> {
    let local = mix(v.morph_from, v.position, morph_weight(frame.time_s - v.birth_s));
    let moved = part_moved(posed(local, v, v.states), part_move(v, v.states));
    return in_world(moved, v.offset_scale, v.rotation);
}

fn second_uv_of(v: VertexIn) -> vec2<f32> {
    if (!SECOND_UV) {
        return vec2(0.0);
    }
    return attributes_of(v.part_and_level).second_uv;
}

@vertex
fn vs_surface(v: VertexIn) -> Surface {
    var out: Surface;
    let state = part_state(v);
    out.position = placed(v);
    out.clip = shown(out.position, state);
    let move_at = part_move(v, v.states);
    var normal = posed_normal(v.normal.xyz, v);
    if (move_at != 0u) {
        normal = rotate(part_move_at(move_at + 4u), normal);
    }
    out.normal = rotate(v.rotation, normal);
    out.uv = vec2(v.uv.x, 1.0 - v.uv.y);
    out.second_uv = second_uv_of(v);
    out.level = v.part_and_level & 255u;
    out.tint = state & ~HIDDEN;
    out.colour = vec4(linear_from_srgb(v.colour.rgb), v.colour.a);
    return out;
}

// Shadow caster: `frame` then holds the sun's view.
@vertex
fn vs_caster(v: VertexIn) -> @builtin(position) vec4<f32> {
    return shown(placed(v), part_state(v));
}

@vertex
fn vs_pierced(v: VertexIn) -> Pierced {
    return Pierced(shown(placed(v), part_state(v)), vec2(v.uv.x, 1.0 - v.uv.y), v.colour.a, second_uv_of(v));
}

// Edges, counted. Moved towards the eye by two thousandths of their depth, which keeps them in
// front of the faces they belong to.
@vertex
fn vs_wire(v: VertexIn) -> @builtin(position) vec4<f32> {
    var clip = shown(placed(v), part_state(v));
    clip.z *= 1.0 + WIRE_AHEAD * frame.to_sun.w;
    return clip;
}
