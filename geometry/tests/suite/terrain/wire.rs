//! What features cost on the wire.

use lodestream_geometry::terrain::{
    Mode, PARAMETERS_BYTES, PatchPoint, PatchPoints, Shape, Stamp, decode_points, encode_points,
    encode_stamps,
};

/// Height units between two heights of [`valley`]; its depth is 240 of them.
const STEP: i32 = 16;

/// A winding valley through a patch of 257 x 257 points: 4,129 points, a sixteenth of it. It is 16 points wide,
/// at its mouth 17, and 60 m deep at a step of 25 cm; its cross-section is a raised cosine.
fn valley(step: i32) -> PatchPoints {
    let mut points = Vec::new();
    for y in 0..257_u16 {
        let width = if y < 17 { 17_u16 } else { 16 };
        let turn = f64::from(y) / 257.0 * std::f64::consts::TAU;
        let centre = 128.0 + 50.0 * (turn * 1.25).sin() + 9.0 * (turn * 4.0).cos();
        let first = (centre - f64::from(width) / 2.0).round() as u16;
        for x in first..first + width {
            let across = (f64::from(x) - centre) / (f64::from(width) / 2.0 + 1.0);
            let depth = 240.0 * 16.0 * (0.5 + 0.5 * (across * std::f64::consts::PI).cos());
            let height = -(depth / f64::from(step)).round() as i32 * step;
            points.push(PatchPoint { x, y, mode: Mode::Additive, height });
        }
    }
    PatchPoints::new(8, points).unwrap()
}

#[test]
fn a_valley_of_4129_points_costs_less_than_2_kilobytes() {
    let valley = valley(STEP);
    assert_eq!(valley.len(), 4129);
    let bytes = encode_points(8, &valley).unwrap();
    assert_eq!(decode_points(8, &bytes).unwrap(), valley);
    println!("{} bytes", bytes.len());
    assert!(bytes.len() <= 2048, "{} bytes", bytes.len());
}

#[test]
fn a_valley_as_a_stamp_costs_less_than_100_bytes() {
    let line = (0..16).map(|i| [128 + [0, 40, 50, 20, -20, -40, -50, -10][i as usize % 8], i * 17]).collect();
    let winding = Shape::RiverBed { line, half_width: 9, depth: 3840 };
    let straight = Shape::Valley { from: [100, 0], to: [150, 257], half_width: 9, depth: 3840 };
    let size =
        |shape: &Shape| encode_stamps(&[Stamp { mode: Mode::Additive, shape: shape.clone() }]).unwrap().len();
    println!("{} and {} bytes", size(&winding), size(&straight));
    assert!(size(&winding) <= 100 && size(&straight) <= 20);
}

#[test]
fn parameters_fit_in_32_bytes_with_two_scales() {
    assert!(PARAMETERS_BYTES + 2 * size_of::<f32>() <= 32);
}
