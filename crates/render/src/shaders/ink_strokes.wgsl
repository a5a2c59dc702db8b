// Strokes as capsules, hidden where something lies before their spine. CPU reference: cpu_reference/ink.rs.

struct Stroke {
    start: vec4<f32>, // with half the most that it may be wide
    end: vec4<f32>,
}

@group(0) @binding(1) var depth_map: texture_2d<f32>;
@group(0) @binding(2) var<storage, read> strokes: array<Stroke>;
@group(0) @binding(3) var<uniform> ink: Ink;

// By how much a stroke's depth may lie behind what is there.
const BIAS: f32 = 0.002;

struct Capsule {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) start: vec3<f32>,
    @location(1) @interpolate(flat) end: vec3<f32>,
    @location(2) @interpolate(flat) half_width: f32,
}

@vertex
fn vs_stroke(@builtin(vertex_index) vertex: u32, @builtin(instance_index) number: u32) -> Capsule {
    let stroke = strokes[number];
    let way = stroke.end.xy - stroke.start.xy;
    let size = length(way);
    let half_width = min(ink.half_width, stroke.start.w);
    let along = select(vec2(1.0, 0.0), way / size, size > 0.0) * (half_width + 1.0);
    let across = vec2(-along.y, along.x);
    // Two triangles: corners 0 1 2, 2 1 3.
    let corner = (0xda4u >> (2u * vertex)) & 3u;
    let at_end = (corner & 1u) == 1u;
    let place = select(stroke.start.xy - along, stroke.end.xy + along, at_end)
        + select(-across, across, (corner & 2u) == 2u);
    let ndc = (place / frame.size_px - 0.5) * vec2(2.0, -2.0);
    return Capsule(vec4(ndc, 0.5, 1.0), stroke.start.xyz, stroke.end.xyz, half_width);
}

// How much of a pixel a stroke covers, whose spine it is so far from; one that is narrower than a pixel never all of it.
fn covered(distance: f32, half_width: f32) -> f32 {
    return clamp(half_width + 0.5 - distance, 0.0, min(2.0 * half_width, 1.0));
}

// Whether a point of a spine is seen. A contour lies on the edge of its surface, and pixels beside it on either: it is seen
// where it is not behind the furthest of them (the spine decides: Cole and Finkelstein, "Two fast methods for high-quality
// line visibility", 2010).
fn is_seen(spine: vec2<f32>, depth: f32) -> bool {
    let last = vec2<i32>(frame.size_px) - 1;
    let pixel = vec2<i32>(floor(spine));
    var furthest = 1.0;
    for (var y = -1; y <= 1; y++) {
        for (var x = -1; x <= 1; x++) {
            furthest = min(furthest, textureLoad(depth_map, clamp(pixel + vec2(x, y), vec2(0), last), 0).x);
        }
    }
    return depth >= furthest * (1.0 - BIAS * frame.to_sun.w);
}

// Whether a section plane cuts away a point of a spine.
fn is_cut_there(spine: vec2<f32>, stored: f32) -> bool {
    let ndc = ((spine + frame.jitter) / frame.size_px * 2.0 - 1.0) * vec2(1.0, -1.0);
    let place = vec3(ndc * frame.tan_half_fov, -1.0) * view_depth(stored);
    return is_cut((transpose(frame.view_from_world) * vec4(place, 0.0)).xyz);
}

@fragment
fn fs_stroke(c: Capsule) -> @location(0) vec4<f32> {
    let way = c.end.xy - c.start.xy;
    let square = dot(way, way);
    let share = clamp(dot(c.clip.xy - c.start.xy, way) / max(square, 1e-12), 0.0, 1.0);
    let spine = c.start.xy + way * share;
    let cover = covered(length(c.clip.xy - spine), c.half_width);
    let stored = mix(c.start.z, c.end.z, share);
    if (cover <= 0.0 || !is_seen(spine, stored) || is_cut_there(spine, stored)) {
        discard;
    }
    return vec4(cover, 0.0, 0.0, 0.0);
}
