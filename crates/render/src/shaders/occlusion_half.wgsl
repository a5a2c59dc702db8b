// Half-resolution occlusion. CPU reference: cpu_reference/occlusion/half.rs.

// The pixel of a 2x2 that is estimated: each of the four in every fourth, so that of lines a pixel wide every second along
// them is met.
fn half_pixel(cell: vec2<i32>) -> vec2<i32> {
    return min(2 * cell + (cell.yx & vec2(1)), vec2<i32>(frame.size_px) - 1);
}
