// Where a ray meets what is on the picture. CPU reference: cpu_reference/reflections.rs. Who includes this declares `depth_map`, `pyramid` and
// `tracing`.

// By cells of the pyramid, or pixel by pixel.
override HI_Z: bool = false;

struct Tracing {
    steps: u32,
    levels: u32, // of the pyramid, above the picture's own
    thickness: f32, // share of its depth that what is drawn is thick
    unused: u32,
}

// Roughness from which less is mirrored of the picture, and from which on nothing is.
const MIRRORS: vec2<f32> = vec2(0.2, 0.5);
// Share of the picture's shorter side over which reflections fade towards its border.
const BORDER: f32 = 0.1;
// Depths of itself at which a ray ends that goes away from the eye, and the share of its depth at which one ends that comes
// towards it.
const FARTHEST: f32 = 1e4;
const CLOSEST: f32 = 1e-3;
// How far past a cell's side the next one is looked up, pixels.
const NUDGE: f32 = 0.01;

// A line on the picture: pixels and stored depth, where it begins and what it goes until it ends.
struct Line {
    start: vec3<f32>,
    way: vec3<f32>,
}

// A place in view space as pixels and stored depth.
fn on_picture(place: vec3<f32>) -> vec3<f32> {
    let ndc = place.xy / (frame.tan_half_fov * -place.z);
    return vec3((vec2(ndc.x, -ndc.y) * 0.5 + 0.5) * frame.size_px - frame.jitter, frame.near / -place.z);
}

// A ray from a place in view space, cut to the picture. Its way is nothing where it begins outside.
fn line_of(place: vec3<f32>, direction: vec3<f32>) -> Line {
    let depth = -place.z;
    var len = FARTHEST * depth;
    if (direction.z > 0.0) {
        len = min(len, (1.0 - CLOSEST) * depth / direction.z);
    }
    let start = on_picture(place);
    var way = on_picture(place + direction * len) - start;
    let room = select(-start.xy, frame.size_px - start.xy, way.xy > vec2(0.0));
    let parts = select(room / way.xy, vec2(1.0), way.xy == vec2(0.0));
    way *= clamp(min(parts.x, parts.y), 0.0, 1.0);
    return Line(start, way);
}

fn is_inside(pixel: vec2<i32>) -> bool {
    return all(pixel >= vec2(0)) && all(pixel < vec2<i32>(frame.size_px));
}

// Whether depths that a ray goes through, as they are stored, meet a surface.
fn meets(nearer: f32, further: f32, surface: f32) -> bool {
    return surface > 0.0 && further <= surface && surface <= nearer * (1.0 + tracing.thickness * frame.to_sun.w);
}

// The pixel where a line meets something; (-1, -1) where it meets nothing.
fn linear_hit(line: Line) -> vec2<i32> {
    let pixels = max(abs(line.way.x), abs(line.way.y));
    let step = line.way / max(pixels, 1.0);
    let count = min(u32(pixels), tracing.steps);
    for (var i = 1u; i <= count; i++) {
        let at = line.start + step * f32(i);
        let pixel = vec2<i32>(floor(at.xy));
        if (!is_inside(pixel)) {
            break;
        }
        // Met where it is behind now and was not further behind than it is thick a step ago.
        if (meets(max(at.z, at.z - step.z), at.z, textureLoad(depth_map, pixel, 0).x)) {
            return pixel;
        }
    }
    return vec2(-1);
}

// Nearest depth in a cell of a level; level 0 is the picture.
fn nearest_in(cell: vec2<i32>, level: u32) -> f32 {
    if (level == 0u) {
        return textureLoad(depth_map, cell, 0).x;
    }
    return textureLoad(pyramid, cell, i32(level) - 1).x;
}

// Part of the line at which it leaves a cell, and a little more.
fn leaving(line: Line, cell: vec2<i32>, side: f32) -> f32 {
    let bound = vec2<f32>(cell + select(vec2(0), vec2(1), line.way.xy > vec2(0.0))) * side;
    let parts = select((bound - line.start.xy) / line.way.xy, vec2(1e30), line.way.xy == vec2(0.0));
    return min(parts.x, parts.y) + NUDGE / max(abs(line.way.x), abs(line.way.y));
}

fn hi_z_hit(line: Line) -> vec2<i32> {
    if (max(abs(line.way.x), abs(line.way.y)) < 1.0) {
        return vec2(-1);
    }
    var part = leaving(line, vec2<i32>(floor(line.start.xy)), 1.0);
    var level = 0u;
    for (var i = 0u; i < tracing.steps && part < 1.0; i++) {
        let side = f32(1u << level);
        let at = line.start + line.way * part;
        if (!is_inside(vec2<i32>(floor(at.xy)))) {
            break;
        }
        let cell = vec2<i32>(floor(at.xy / side));
        let nearest = nearest_in(cell, level);
        let after = max(leaving(line, cell, side), part);
        let left = line.start.z + line.way.z * min(after, 1.0);
        let further = min(at.z, left);
        if (further > nearest) {
            // Nothing in it can be met.
            part = after;
            level = min(level + 1u, tracing.levels);
        } else if (level > 0u) {
            if (at.z > nearest) {
                // Up to where it is as far as the nearest.
                part = max(part, (nearest - line.start.z) / line.way.z);
            }
            level -= 1u;
        } else if (meets(max(at.z, left), further, nearest)) {
            return cell;
        } else {
            part = after;
        }
    }
    return vec2(-1);
}

// What a ray meets on the picture: the pixel, and how much that counts for by how near the border it is; 0 for nothing.
struct Met {
    pixel: vec2<i32>,
    share: f32,
}

// `place`, `normal` of the surface and the ray's unit direction in view space.
fn trace(place: vec3<f32>, normal: vec3<f32>, direction: vec3<f32>) -> Met {
    if (dot(direction, normal) <= 0.0) {
        return Met(vec2(0), 0.0);
    }
    let lifted = place + normal * (-place.z / frame.scale_px);
    let line = line_of(lifted, direction);
    var pixel = vec2(-1);
    if (HI_Z) {
        pixel = hi_z_hit(line);
    } else {
        pixel = linear_hit(line);
    }
    if (pixel.x < 0) {
        return Met(vec2(0), 0.0);
    }
    let inside = min(vec2<f32>(pixel) + 0.5, frame.size_px - vec2<f32>(pixel) - 0.5);
    let border = BORDER * min(frame.size_px.x, frame.size_px.y);
    return Met(pixel, clamp(min(inside.x, inside.y) / border, 0.0, 1.0));
}

// Weight of a single ray by roughness.
fn mirrors(roughness: f32) -> f32 {
    return 1.0 - smoothstep(MIRRORS.x, MIRRORS.y, roughness);
}
