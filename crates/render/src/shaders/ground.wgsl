// Ground cover: textured layers with heights, at three scales.

// Repetitions of the finest scale in one of the near one.
const DETAILS: f32 = 8.0;
// Of the colours, the mean.
const MEAN_LEVEL: f32 = 16.0;

// A plane that layers are laid onto.
struct Plane {
    near: vec2<f32>, // texture coordinates at the near scale
    far: vec2<f32>,
    dx: vec2<f32>, // of world units along it, by pixels
    dy: vec2<f32>,
}

fn turned(p: vec2<f32>) -> vec2<f32> {
    return vec2(0.8 * p.x - 0.6 * p.y, 0.6 * p.x + 0.8 * p.y);
}

// Texture coordinates at the far scale: turned, so that the two repetitions never line up.
fn far_uv(across: vec2<f32>) -> vec2<f32> {
    return turned(across + terrain.eye_in_far) / terrain.periods.y;
}

fn near_uv(across: vec2<f32>) -> vec2<f32> {
    return (across + terrain.eye_in_near) / terrain.periods.x;
}

// A plane from places along it, which are within both scales' repetitions.
fn plane(near: vec2<f32>, far: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> Plane {
    return Plane(near / terrain.periods.x, turned(far) / terrain.periods.y, dx, dy);
}

// Ground height of a layer at the near scale, 0 to 1.
fn layer_height(uv: vec2<f32>, layer: i32, lod: f32) -> f32 {
    return textureSampleLevel(layers, layer_sampler, uv, layer, lod).a;
}

fn layer_at(layer: i32, uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> vec4<f32> {
    let f = footprint(dx, dy, vec2<f32>(textureDimensions(layers)));
    var sum = vec4(0.0);
    for (var i = 0; i < f.count; i++) {
        sum += textureSampleGrad(layers, layer_sampler, looked_up(f, uv, i), layer, f.dx, f.dy);
    }
    return sum / f32(f.count);
}

// Of the near scale's texels, how many a pixel spans.
fn texels_a_pixel(p: Plane) -> f32 {
    return max(length(p.dx), length(p.dy)) / terrain.periods.x * f32(textureDimensions(layers).x);
}

// How much of the finest scale is seen: where the near one's texels are larger than pixels.
fn detail(p: Plane) -> f32 {
    return 1.0 - smoothstep(0.3, 1.0, texels_a_pixel(p));
}

// The layer that shows a layer from near: grass is blades then, others are alike at all scales.
fn detail_layer(layer: i32) -> i32 {
    return select(layer, 4, layer == 1);
}

// What a layer gives a place.
struct Covered {
    colour: vec3<f32>,
    height: f32,
    slope: vec2<f32>, // rise of the finest scale's heights along the plane
}

// A layer: two scales, weighed by a third, so that no repetition is seen twice alike; and the finest one's contrast.
fn ground(layer: i32, p: Plane, blotch: f32) -> Covered {
    let near = layer_at(layer, p.near, p.dx / terrain.periods.x, p.dy / terrain.periods.x);
    // What is coarse anyway, and what is seen from near alone, one lookup does.
    let far = textureSampleGrad(layers, layer_sampler, p.far, layer, turned(p.dx) / terrain.periods.y, turned(p.dy) / terrain.periods.y);
    var covered = Covered(mix(near.rgb, far.rgb, 0.35 + 0.3 * blotch), near.a, vec2(0.0));
    let seen = detail(p);
    // Once, or not at all: drivers in software jump over loops, but take both ways of a branch.
    for (var once = 0.0; once < seen; once += 1.0) {
        let finer = detail_layer(layer);
        let scale = DETAILS / terrain.periods.x;
        let uv = p.near * DETAILS;
        let texel = textureSampleGrad(layers, layer_sampler, uv, finer, p.dx * scale, p.dy * scale).rgb;
        let mean = textureSampleLevel(layers, layer_sampler, p.near, finer, MEAN_LEVEL).rgb;
        covered.colour *= mix(vec3(1.0), texel / mean, seen);
        let lod = max(log2(max(texels_a_pixel(p) * DETAILS, 1e-6)), 0.0);
        let step = exp2(lod) / f32(textureDimensions(layers).x);
        let du = layer_height(uv + vec2(step, 0.0), finer, lod) - layer_height(uv - vec2(step, 0.0), finer, lod);
        let dv = layer_height(uv + vec2(0.0, step), finer, lod) - layer_height(uv - vec2(0.0, step), finer, lod);
        // As deep in its repetition as the near scale is in its own.
        covered.slope = vec2(du, dv) * (seen * terrain.relief_depth / (2.0 * step * terrain.periods.x));
    }
    return covered;
}
