//! The commands `terrain` and `terrain-import`.

use std::path::Path;
use std::process::{Command, Output};

use lodestream_terrain::{Parameters, Terrain, fingerprint};
use tempfile::TempDir;

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lodestream-server")).args(arguments).output().unwrap()
}

/// Standard output of a command that must succeed.
fn said(arguments: &[&str]) -> String {
    let output = run(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Runs a command that must be refused: exit code 2, one line on standard error, and no new file.
fn refused(dir: &TempDir, arguments: &[&str], fragments: &[&str]) {
    let files = || std::fs::read_dir(dir.path()).unwrap().count();
    let before = files();
    let output = run(arguments);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert!(output.stdout.is_empty() && files() == before, "{arguments:?}");
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    for fragment in fragments {
        assert!(message.contains(fragment), "{message:?} lacks {fragment:?}");
    }
}

fn heights(path: &Path) -> Vec<i32> {
    std::fs::read(path).unwrap().chunks(4).map(|b| i32::from_le_bytes(b.try_into().unwrap())).collect()
}

#[test]
fn raw_picture_and_hash_are_of_one_patch() {
    let dir = TempDir::new().unwrap();
    let (raw, png) = (dir.path().join("p.i32"), dir.path().join("p.png"));
    let patch = ["terrain", "--seed", "7", "--level", "6", "--patch", "-3,5"];
    let told = said(&[&patch[..], &["--raw", text(&raw)]].concat());
    let values = heights(&raw);
    let parameters = Parameters { seed: 7, finest_level: 6, extent_log2: 25, ..Parameters::default() };
    assert_eq!(values, Terrain::new(parameters).unwrap().patch(-3, 5, 6).unwrap());
    let hash = format!("{:016x}", fingerprint(&values));
    assert_eq!(said(&[&patch[..], &["--hash"]].concat()), format!("{hash}\n"));
    let (low, high) = (*values.iter().min().unwrap(), *values.iter().max().unwrap());
    assert_eq!(told, format!("{}: 65 x 65 heights, {low} to {high}, hash {hash}\n", text(&raw)));
    said(&[&patch[..], &["--png", text(&png)]].concat());
    let picture = image::open(&png).unwrap();
    let image::DynamicImage::ImageLuma16(picture) = picture else { panic!("{:?}", picture.color()) };
    assert_eq!((picture.width(), picture.height()), (65, 65));
    let white = (high - low).max(65_535);
    let grey = |h: i32| (i64::from(h - low) * 65_535 / i64::from(white)) as u16;
    assert!(picture.as_raw().iter().zip(&values).all(|(&p, &h)| p == grey(h)));
}

#[test]
fn coarse_levels_are_subsets_of_the_finest_with_features_and_erosion() {
    let dir = TempDir::new().unwrap();
    let features = dir.path().join("f.json");
    std::fs::write(
        &features,
        r#"[{"mode": "fixed", "points": [[-130, 70, 5000], [-192, 64, -9], [-150, 100, 1]]},
            {"mode": "additive", "stamps": [
            {"kind": "valley", "from": [-190, 60], "to": [-130, 128], "half_width": 9, "depth": 800}]}]"#,
    )
    .unwrap();
    for erosion in [&[][..], &["--erosion", "6", "--erosion-level", "4", "--spike-limit", "0.5"]] {
        let patch = |level: &str, name: &str| {
            let path = dir.path().join(name);
            let arguments = ["terrain", "--level", level, "--finest", "6", "--patch", "-3,1"];
            let files = ["--features", text(&features), "--raw", text(&path)];
            said(&[&arguments[..], &files, erosion].concat());
            heights(&path)
        };
        let (coarse, fine) = (patch("3", "coarse"), patch("6", "fine"));
        for (i, &height) in coarse.iter().enumerate() {
            assert_eq!(height, fine[i / 9 * 8 * 65 + i % 9 * 8]);
        }
        assert_eq!((fine[6 * 65 + 62], fine[0], fine[36 * 65 + 42]), (5000, -9, 1));
    }
}

#[test]
fn imported_height_maps_reproduce_their_heights() {
    let dir = TempDir::new().unwrap();
    let (map, features, raw) =
        (dir.path().join("m.png"), dir.path().join("f.json"), dir.path().join("o.i32"));
    let grey =
        |x: u32, y: u32| (20_000.0 + 9000.0 * (f64::from(x) * 0.08).sin() + 90.0 * f64::from(y)) as u16;
    let picture = image::ImageBuffer::from_fn(65, 65, |x, y| image::Luma([grey(x, y)]));
    picture.save(&map).unwrap();
    let import = |every: &str| {
        said(&[
            "terrain-import",
            text(&map),
            "-o",
            text(&features),
            "--every",
            every,
            "--finest",
            "6",
            "--at",
            "-64,0",
        ])
    };
    let told = import("1");
    assert!(told.contains("4225 fixed points of 65 x 65 pixels\n"), "{told}");
    assert!(
        told.contains("height units: max 0, RMS 0.00; without random offsets: max 0, RMS 0.00"),
        "{told}"
    );
    said(&["terrain", "--level", "6", "--patch", "-1,0", "--features", text(&features), "--raw", text(&raw)]);
    let values = heights(&raw);
    assert!((0..65 * 65).all(|i| values[i as usize] == i32::from(grey(i % 65, i / 65))));
    let told = import("8");
    assert!(told.contains("81 fixed points") && !told.contains("max 0"), "{told}");
}

#[test]
fn unusable_arguments_are_refused_with_a_reason() {
    let dir = TempDir::new().unwrap();
    let (features, out) = (dir.path().join("f.json"), dir.path().join("out"));
    let patch = ["terrain", "--level", "6", "--patch", "0,0", "--raw", text(&out)];
    let with = |more: &[&'static str]| [&patch[..], more].concat();
    refused(&dir, &with(&["--finest", "5"]), &["level 6 is outside 0..=5"]);
    let deep = ["terrain", "--level", "13", "--patch", "0,0", "--raw", text(&out)];
    refused(&dir, &deep, &["--finest", "1 to 12 levels are possible; 13 is not"]);
    refused(&dir, &with(&["--amplitude", "4000000000"]), &["lower the amplitude"]);
    refused(&dir, &with(&["--erosion", "3", "--erosion-level", "7"]), &["erosion level is 7"]);
    let far = ["terrain", "--level", "6", "--patch", "33554432,0", "--raw", text(&out)];
    refused(&dir, &far, &["patch 33554432, 0 is outside the world"]);
    let featured =
        ["terrain", "--level", "6", "--patch", "0,0", "--raw", text(&out), "--features", text(&features)];
    refused(&dir, &featured, &["f.json", "cannot be read"]);
    for (json, fragments) in [
        (r#"{"mode": "fixed", "points": [[1, 2, 3], [1, 2, 4]]}"#, &["f.json", "point 1", "given twice"][..]),
        (r#"{"mode": "fixed", "points": [[1, 9999999999, 3]]}"#, &["point 0", "outside the world"]),
        (r#"{"mode": "fixed", "points": [[1, 2, 9999999999]]}"#, &["point 0", "9999999999"]),
        (r#"{"mode": "fixed", "points": [[1.5, 2, 3]]}"#, &["floating point", "line 1", "whole numbers"]),
        (r#"{"mode": "fixed", "stamps": [{"kind": "hill"}]}"#, &["unknown variant `hill`"]),
        (
            r#"{"mode": "fixed", "stamps": [{"kind": "crater", "centre": [0, 0], "radius": 0, "depth": 1, "rim": 1}]}"#,
            &["stamp 0", "radius of 0"],
        ),
        ("hello", &["is not a feature file", "line 1 column 1"]),
    ] {
        std::fs::write(&features, json).unwrap();
        refused(&dir, &featured, fragments);
    }
    let map = dir.path().join("m.png");
    image::RgbImage::new(3, 3).save(&map).unwrap();
    let import = ["terrain-import", text(&map), "-o", text(&out)];
    refused(&dir, &import, &["m.png", "Rgb8", "16-bit grey"]);
    std::fs::write(&map, "no picture").unwrap();
    refused(&dir, &import, &["m.png"]);
}
