// The picture of a studio's ground: share of the key light, and openness to light from around. Samples on Vogel's spiral
// are turned from texel to texel, in a pattern of 4x4 over which floor_smooth.wgsl takes the mean. Lengths are in radii
// of the objects.

@group(0) @binding(3) var undersides: texture_depth_2d_array;
@group(0) @binding(4) var key_map: texture_depth_2d_array;

// Where casters are looked for, and the radius of the light seen from a caster per distance (Fernando, "Percentage-closer
// soft shadows", 2005).
const SEARCH: f32 = 0.22;
const LIGHT: f32 = 0.13;
const LEAST_BLUR: f32 = 0.012;
const SEARCHED: i32 = 16;
const LOOKED_UP: i32 = 32;
// What is nearer above the ground than this casts no shadow: rounding.
const RAISED: f32 = 0.002;
// Reach around contacts, narrow and wide; heights over which undersides lose their effect; share of light that they hide.
const REACH: vec2<f32> = vec2(0.14, 0.6);
const HEIGHT: vec2<f32> = vec2(0.05, 0.3);
const HIDDEN: vec2<f32> = vec2(0.6, 0.75);
const AROUND: i32 = 24;

// Sample of a spiral in the unit circle; `power` ½ spreads samples evenly, more draws them to its middle.
fn spiral(i: i32, count: i32, turn: f32, power: f32) -> vec2<f32> {
    let angle = f32(i) * 2.3999632 + turn;
    return pow((f32(i) + 0.5) / f32(count), power) * vec2(cos(angle), sin(angle));
}

// Depth on the key light's map above a place, 0 where nothing is.
fn caster(place: vec2<f32>) -> f32 {
    let size = vec2<i32>(textureDimensions(key_map));
    let texel = vec2<i32>(floor(place * vec2<f32>(size)));
    if (any(texel < vec2(0)) || any(texel >= size)) {
        return 0.0;
    }
    return textureLoad(key_map, texel, 0, 0);
}

// Share of the key light at a place on the ground.
fn key_light(at: vec3<f32>, turn: f32) -> f32 {
    let radius = studio.size.x;
    let place = (studio.key_from_floor * vec4(at, 1.0)).xyz;
    // The ground may be deeper than the map shows.
    let least = max(place.z + RAISED * radius / studio.range.w, 0.0);
    let scale = radius * studio.size.y;
    var sum = 0.0;
    var count = 0.0;
    for (var i = 0; i < SEARCHED; i++) {
        let depth = caster(place.xy + spiral(i, SEARCHED, turn, 0.5) * SEARCH * scale);
        if (depth > least) {
            sum += depth - place.z;
            count += 1.0;
        }
    }
    if (count == 0.0) {
        return 1.0;
    }
    let distance = sum / count * studio.range.w / radius;
    let blur = clamp(LIGHT * distance, LEAST_BLUR, SEARCH) * scale;
    var lit = 0.0;
    for (var i = 0; i < LOOKED_UP; i++) {
        lit += f32(caster(place.xy + spiral(i, LOOKED_UP, turn, 0.5) * blur) <= least);
    }
    return lit / f32(LOOKED_UP);
}

// Mean over a circle of how near undersides are to the ground.
fn nearness(at: vec3<f32>, turn: f32, reach: f32, height: f32) -> f32 {
    let size = vec2<i32>(textureDimensions(undersides));
    var sum = 0.0;
    for (var i = 0; i < AROUND; i++) {
        let there = at.xy + spiral(i, AROUND, turn, 0.65) * reach * studio.size.x;
        // Rows from the top.
        let place = 0.5 + vec2(there.x, -there.y) * studio.range.x;
        let texel = vec2<i32>(floor(place * vec2<f32>(size)));
        if (any(texel < vec2(0)) || any(texel >= size)) {
            continue;
        }
        let depth = textureLoad(undersides, texel, 0, 0);
        if (depth > 0.0) {
            sum += exp((down_of(depth) - at.z) / (height * studio.size.x));
        }
    }
    return sum / f32(AROUND);
}

// `size` of the picture in texels.
override WIDTH: f32 = 256.0;
override ROWS: f32 = 192.0;

@fragment
fn fs_picture(on: OnFloor) -> @location(0) vec4<f32> {
    let pixel = vec2<u32>(on.position.xy);
    let from_middle = on.position.xy / vec2(WIDTH, ROWS) * 2.0 - 1.0;
    let at = vec3(studio.picture.xy + from_middle * studio.picture.zw, down_of(on.lowest));
    let turn = f32((pixel.y & 3u) * 4u + (pixel.x & 3u)) * (6.2831853 / 16.0);
    let near = vec2(nearness(at, turn, REACH.x, HEIGHT.x), nearness(at, turn, REACH.y, HEIGHT.y));
    let open = (1.0 - HIDDEN.x * near.x) * (1.0 - HIDDEN.y * near.y);
    // Nothing at the border.
    let shown = 1.0 - smoothstep(0.8, 1.0, max(abs(from_middle.x), abs(from_middle.y)));
    return vec4(mix(vec2(1.0), vec2(key_light(at, turn), open), shown), 0.0, 1.0);
}
