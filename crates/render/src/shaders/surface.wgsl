// Positions and normals reconstructed from depth.

@group(0) @binding(1) var depth_map: texture_2d<f32>;

fn depth_at(pixel: vec2<i32>) -> f32 {
    let p = clamp(pixel, vec2(0), vec2<i32>(frame.size_px) - 1);
    return view_depth(textureLoad(depth_map, p, 0).x);
}

fn position_at(pixel: vec2<i32>) -> vec3<f32> {
    return view_ray(pixel) * depth_at(pixel);
}

// Normal of the surface from depth, taking on each axis the neighbour that is nearer in depth, so
// that silhouettes do not bend it. Geometric, not shaded: smooth normals on coarse facets would
// make them occlude themselves.
fn normal_at(pixel: vec2<i32>, centre: vec3<f32>) -> vec3<f32> {
    let right = position_at(pixel + vec2(1, 0)) - centre;
    let left = centre - position_at(pixel - vec2(1, 0));
    let down = position_at(pixel + vec2(0, 1)) - centre;
    let up = centre - position_at(pixel - vec2(0, 1));
    let dx = select(left, right, pixel.x == 0 || (abs(right.z) < abs(left.z) && pixel.x + 1 < i32(frame.size_px.x)));
    let dy = select(up, down, pixel.y == 0 || (abs(down.z) < abs(up.z) && pixel.y + 1 < i32(frame.size_px.y)));
    return facing(dx, dy, centre);
}

// The normal of what two differences of places span, towards the eye; that way itself where they span nothing.
fn facing(dx: vec3<f32>, dy: vec3<f32>, centre: vec3<f32>) -> vec3<f32> {
    let n = cross(dx, dy);
    let len = length(n);
    let towards_eye = -normalize(centre);
    if (!(len > 1e-30 && len < 1e30)) {
        return towards_eye;
    }
    return select(-n, n, dot(n, towards_eye) > 0.0) / len;
}
