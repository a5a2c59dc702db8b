//! Encoded sizes of features.

use lodestream_terrain::{
    HeightOverride, HeightOverrides, Mode, PARAMETERS_BYTES, Shape, Stamp, decode_points, encode_points,
    encode_stamps,
};

/// A winding valley through a patch of 257 x 257 points, encoded: 4,129 additive points, a sixteenth of the patch. It
/// is 16 points wide (17 at its mouth) and 60 m deep; its cross-section is a raised cosine. Heights are multiples of 16
/// units, the height step: 25 cm.
const VALLEY: &[u8] = include_bytes!("valley-4129.points");

/// The points of [`VALLEY`].
fn valley() -> HeightOverrides {
    let step = 16;
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
            points.push(HeightOverride { x, y, mode: Mode::Additive, height });
        }
    }
    HeightOverrides::new(8, points).unwrap()
}

#[test]
fn a_valley_of_4129_points_costs_less_than_2_kilobytes() {
    let points = decode_points(8, VALLEY).unwrap();
    assert_eq!(points.len(), 4129);
    assert!(points.as_slice().iter().all(|p| p.height % 16 == 0 && p.height < 0));
    assert_eq!(encode_points(8, &points).unwrap(), VALLEY, "the same points, the same bytes");
    println!("{} bytes", VALLEY.len());
    assert!(VALLEY.len() <= 2048, "{} bytes", VALLEY.len());
}

/// Run after a change of the encoding: `cargo test -p lodestream-terrain --test suite -- --ignored write_the_valley`.
#[test]
#[ignore = "writes the fixture"]
#[expect(clippy::disallowed_methods, reason = "only this writes, and only when asked to")]
fn write_the_valley() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/suite/valley-4129.points");
    std::fs::write(file, encode_points(8, &valley()).unwrap()).unwrap();
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
