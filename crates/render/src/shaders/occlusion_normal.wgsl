// Normals reconstructed from depth for occlusion. Of a pixel's two neighbours on each axis one may lie on another
// surface; beside an inner edge the nearer in depth often does. The choice is compiled in. CPU reference:
// cpu_reference/occlusion/normal.rs.

// Numbers of `OcclusionNormals`. 0: the nearer in depth.
override SIDES: u32 = 0u;
const DRAWN: u32 = 1u;
const EXTENDED: u32 = 2u;

// By how much more of a cosine another pair of sides must agree with the drawn normal than that of the nearer.
const AGREEMENT: f32 = 0.01;

@group(0) @binding(3) var surface_normals: texture_2d<f32>;

fn receiver_normal(pixel: vec2<i32>, centre: vec3<f32>) -> vec3<f32> {
    if (SIDES == DRAWN) {
        return agreeing_normal(pixel, centre);
    }
    if (SIDES == EXTENDED) {
        return extended_normal(pixel, centre);
    }
    return normal_at(pixel, centre);
}

// Of the four pairs of sides that whose normal agrees best with the one that is drawn, smooth or out of a map as it may be.
fn agreeing_normal(pixel: vec2<i32>, centre: vec3<f32>) -> vec3<f32> {
    var best = normal_at(pixel, centre);
    let stored = textureLoad(surface_normals, pixel, 0);
    if (is_unlit(stored)) {
        return best;
    }
    let drawn = (frame.view_from_world * vec4(from_octahedral(stored.xy), 0.0)).xyz;
    var agreement = dot(best, drawn) + AGREEMENT;
    let last = vec2<i32>(frame.size_px) - 1;
    for (var pair = 0; pair < 4; pair++) {
        let side = 2 * vec2(pair & 1, pair >> 1u) - 1;
        let x = pixel + vec2(side.x, 0);
        let y = pixel + vec2(0, side.y);
        let outside = x.x < 0 || x.x > last.x || y.y < 0 || y.y > last.y;
        if (outside || depth_at(x) >= FAR || depth_at(y) >= FAR) {
            continue;
        }
        let n = facing(position_at(x) - centre, position_at(y) - centre, centre);
        if (dot(n, drawn) > agreement) {
            best = n;
            agreement = dot(n, drawn);
        }
    }
    return best;
}

fn stored_at(pixel: vec2<i32>) -> f32 {
    return textureLoad(depth_map, clamp(pixel, vec2(0), vec2<i32>(frame.size_px) - 1), 0).x;
}

// How far from the surface at a pixel that of its two neighbours to a side comes out, in stored depth: of a plane that is
// linear in the picture, so it is nothing where all three lie on one.
fn off_line(pixel: vec2<i32>, side: vec2<i32>) -> f32 {
    return abs(2.0 * stored_at(pixel + side) - stored_at(pixel + 2 * side) - stored_at(pixel));
}

// The normal of that side on each axis whose surface goes on through the pixel.
fn extended_normal(pixel: vec2<i32>, centre: vec3<f32>) -> vec3<f32> {
    let last = vec2<i32>(frame.size_px) - 1;
    let x = vec2(1, 0);
    let y = vec2(0, 1);
    let right = pixel.x == 0 || (off_line(pixel, x) < off_line(pixel, -x) && pixel.x < last.x);
    let down = pixel.y == 0 || (off_line(pixel, y) < off_line(pixel, -y) && pixel.y < last.y);
    let dx = position_at(pixel + select(-x, x, right)) - centre;
    let dy = position_at(pixel + select(-y, y, down)) - centre;
    return facing(dx, dy, centre);
}
