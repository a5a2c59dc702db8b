// Anisotropic filtering in the shader: several lookups along the longer axis of a pixel's footprint, each as wide as
// the shorter one (McCormack et al., "Feline: fast elliptical lines for anisotropic texture mapping", 1999; equal
// weights).

struct Footprint {
    count: i32,
    along: vec2<f32>, // its longer axis, texture coordinates
    dx: vec2<f32>, // of one lookup
    dy: vec2<f32>,
}

// The footprint of a pixel with such derivatives on a texture of `size` texels. One lookup where the sampler does the rest.
fn footprint(dx: vec2<f32>, dy: vec2<f32>, size: vec2<f32>) -> Footprint {
    return footprint_of(dx, dy, size, frame.lookups);
}

fn footprint_of(dx: vec2<f32>, dy: vec2<f32>, size: vec2<f32>, most: f32) -> Footprint {
    if (most <= 1.0) {
        return Footprint(1, vec2(0.0), dx, dy);
    }
    // The ellipse that a pixel's circle becomes: axes are the square roots of its matrix' eigenvalues.
    let a = dx * size;
    let b = dy * size;
    let xx = a.x * a.x + b.x * b.x;
    let yy = a.y * a.y + b.y * b.y;
    let xy = a.x * a.y + b.x * b.y;
    let middle = 0.5 * (xx + yy);
    let off = length(vec2(0.5 * (xx - yy), xy));
    let longer = sqrt(middle + off);
    // Below a texel nothing is gained.
    let shorter = max(sqrt(max(middle - off, 0.0)), 1.0);
    let count = clamp(ceil(longer / shorter - 0.25), 1.0, most);
    if (count <= 1.0) {
        return Footprint(1, vec2(0.0), dx, dy);
    }
    let towards = select(vec2(xy, middle + off - xx), vec2(middle + off - yy, xy), xx >= yy);
    let direction = towards / max(length(towards), 1e-20);
    let width = max(longer / count, shorter);
    return Footprint(i32(count), direction * longer / size, direction * width / size, direction.yx * vec2(-width, width) / size);
}

// Where the i-th lookup is.
fn looked_up(f: Footprint, uv: vec2<f32>, i: i32) -> vec2<f32> {
    return uv + f.along * ((f32(i) + 0.5) / f32(f.count) - 0.5);
}

fn anisotropic(map: texture_2d<f32>, map_sampler: sampler, uv: vec2<f32>, f: Footprint) -> vec4<f32> {
    var sum = vec4(0.0);
    for (var i = 0; i < f.count; i++) {
        sum += textureSampleGrad(map, map_sampler, looked_up(f, uv, i), f.dx, f.dy);
    }
    return sum / f32(f.count);
}
