// Triangle edges over the lit picture, faded out where they are dense.

@group(0) @binding(1) var edges_map: texture_2d<f32>;

// Side of the square in which edges are counted: 2 REACH + 1 pixels.
const REACH: i32 = 3;
// Edges per pixel of that square up to which they are drawn in full, and from which on not at all. A triangle with sides
// of s pixels has an area of 0.43 s^2, and each of its sides crosses about 0.9 s pixels: 6.2 / s edges a pixel, since
// both neighbours draw a side. So triangles are drawn from sides of 3 pixels on, and from 7 on in full.
const OPEN: f32 = 0.9;
const FULL: f32 = 2.1;

@fragment
fn fs_wireframe(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    let own = textureLoad(edges_map, pixel, 0).x;
    if (own <= 0.0) {
        discard;
    }
    let last = vec2<i32>(frame.size_px) - 1;
    var sum = 0.0;
    for (var y = -REACH; y <= REACH; y++) {
        for (var x = -REACH; x <= REACH; x++) {
            sum += textureLoad(edges_map, clamp(pixel + vec2(x, y), vec2(0), last), 0).x;
        }
    }
    let side = f32(2 * REACH + 1);
    let edges = sum / (EDGE * side * side);
    return vec4(0.02, 0.02, 0.025, 1.0 - smoothstep(OPEN, FULL, edges));
}
