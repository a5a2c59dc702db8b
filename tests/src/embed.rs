//! `examples/embed`: a package of its own, built as an embedder would, drawing what a daemon serves.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use lodestream_daemon::SessionSettings;

use crate::support::LIMIT;
use crate::support::daemon::{Server, Transport};
use crate::support::picture::{Picture, comparison, draw, headless, keep, same};
use crate::support::scene::TestScene;

/// The example's clear colour, sRGB.
const SKY: [u8; 3] = [170, 108, 89];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

#[test]
fn embedding_takes_at_most_120_lines_in_all() {
    let folder = root().join("examples/embed");
    let files = ["Cargo.toml", "src/main.rs"];
    let lines: usize =
        files.iter().map(|file| std::fs::read_to_string(folder.join(file)).unwrap().lines().count()).sum();
    assert!((50..=120).contains(&lines), "{lines} lines");
    // The counted text must exist.
    assert_eq!(std::fs::read_dir(folder.join("src")).unwrap().count(), 1);
}

/// Builds the example with the workspace's dependency versions, offline; returns the program's path.
fn build() -> PathBuf {
    let root = root();
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), Into::into);
    let folder = root.join("examples/embed");
    std::fs::copy(root.join("Cargo.lock"), folder.join("Cargo.lock")).unwrap();
    // Uses the workspace's target folder and profile, so that dependencies are built once. The workspace's crates have
    // other features here and are built again, without optimisation, which is fastest.
    let manifest: toml::Table =
        toml::from_str(&std::fs::read_to_string(root.join("Cargo.toml")).unwrap()).unwrap();
    let mut dev = manifest["profile"]["dev"].as_table().unwrap().clone();
    dev.insert("opt-level".into(), toml::Value::Integer(0));
    dev["package"].as_table_mut().unwrap().retain(|package, _| !package.starts_with("lodestream"));
    let profile = toml::Table::from_iter([("dev".to_owned(), dev.into())]);
    let config = toml::Table::from_iter([("profile".to_owned(), profile.into())]);
    let file = target.join("embed-profile.toml");
    std::fs::write(&file, config.to_string()).unwrap();
    let mut cargo = Command::new(env!("CARGO"));
    // Removes variables that cargo sets for tests. ring's build script watches one of them: with it, ring and all its
    // dependents would be built again here, and again by the workspace's next build.
    let of_this_package = |name: &OsStr| {
        let own = ["CARGO_MANIFEST_", "CARGO_PKG_", "CARGO_CRATE_NAME", "CARGO_PRIMARY_PACKAGE"];
        name.to_str().is_some_and(|name| own.iter().any(|start| name.starts_with(start)))
    };
    for (name, _) in std::env::vars_os().filter(|(name, _)| of_this_package(name)) {
        cargo.env_remove(name);
    }
    let output = cargo
        .current_dir(&folder)
        .args(["build", "--offline", "--config"])
        .arg(&file)
        .arg("--target-dir")
        .arg(&target)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    target.join("debug/embed").with_extension(std::env::consts::EXE_EXTENSION)
}

/// Shaders are in a program as text.
#[test]
fn the_example_contains_shaders_of_the_default_methods_only() {
    let shaders = std::fs::read_dir(root().join("crates/render/src/shaders")).unwrap();
    let sources: String =
        shaders.map(|file| std::fs::read_to_string(file.unwrap().path()).unwrap()).collect();
    let program = std::fs::read(build()).unwrap();
    let contains = |text: &str| program.windows(text.len()).any(|window| window == text.as_bytes());
    for default in ["fn vs_surface(", "fn relief_halved(", "fn fs_occlusion(", "fn fs_water_added("] {
        assert!(contains(default), "{default}");
    }
    let pn_triangles = ["fn cs_measure(", "fn cs_arrange(", "fn cs_list(", "fn on_patch(", "fn patch_point("];
    let relief = ["RELIEF_OFFSET", "RELIEF_SECANT", "RELIEF_STEEP", "fn relief_cone(", "fn relief_largest("];
    let others = ["fn fs_ink(", "fn cs_strokes(", "fn sectors("];
    for method in [&pn_triangles[..], &relief, &others].concat() {
        assert!(sources.contains(method) && !contains(method), "{method}");
    }
}

#[test]
fn the_example_draws_what_the_viewer_draws() {
    let Some(mut headless) = headless() else { return };
    let program = build();
    let scene = TestScene::small();
    let server = Server::start(scene.source(), SessionSettings::default());
    let folder = tempfile::tempdir().unwrap();
    // The reference: the viewer's renderer with the whole model, before the program's sky.
    let mut whole = draw(&mut headless, scene.whole());
    for (pixel, covered) in whole.image.pixels_mut().zip(&whole.covered) {
        if !covered {
            *pixel = image::Rgba([SKY[0], SKY[1], SKY[2], 255]);
        }
    }
    for transport in Transport::BOTH {
        let file = folder.path().join(format!("{transport:?}.png"));
        let mut child = Command::new(&program)
            .arg(server.url(transport))
            .arg(&file)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let until = Instant::now() + 5 * LIMIT;
        let status = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break status;
            }
            if Instant::now() > until {
                child.kill().unwrap();
                panic!("{transport:?}: no end");
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        assert!(status.success(), "{transport:?}: {status}");
        let image = image::open(&file).unwrap().into_rgba8();
        let picture = Picture { image, covered: whole.covered.clone() };
        keep(&picture, &format!("embed-{transport:?}"));
        let found = comparison(&picture, &whole);
        println!("{transport:?}: {found:?}");
        assert!(found.covered >= 0.2 && same(&found), "{transport:?}: {found:?}");
        // Elsewhere the program's own drawing is untouched.
        let is_sky = |pixel: &image::Rgba<u8>| SKY.iter().zip(pixel.0).all(|(a, b)| a.abs_diff(b) <= 1);
        let free = || picture.image.pixels().zip(&whole.covered).filter(|(_, covered)| !**covered);
        let (sky, all) = (free().filter(|(pixel, _)| is_sky(pixel)).count(), free().count());
        assert!(all > 1000 && sky * 100 >= all * 99, "{transport:?}: {sky} of {all} pixels");
    }
    server.assert_healthy();
}
