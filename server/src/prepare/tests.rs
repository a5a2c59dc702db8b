//! Which of several words about a model counts.

use std::path::Path;

use lodestream_import::recipe::{Precision, Recipe};
use tempfile::TempDir;

use super::{Options, prepare_cached};
use crate::scene;

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

/// What the packs of a scene file say of their making.
fn settings(folder: &Path, scene: &str, flags: Recipe) -> Vec<String> {
    let scene = scene::parse(&folder.join("scene.toml"), scene).unwrap();
    let options = Options { recipe: flags, quiet: true, ..Options::default() };
    let pack = |asset| prepare_cached(asset, &folder.join("cache"), &options).unwrap().pack;
    scene.assets.iter().map(|asset| pack(asset).settings().unwrap()).collect()
}

#[test]
fn a_flag_was_lost_where_the_scene_file_had_a_value() {
    let dir = TempDir::new().unwrap();
    std::fs::write(dir.path().join("a.obj"), TRIANGLE).unwrap();
    let scene = "[[asset]]\nname = 'fine'\nfile = 'a.obj'\nposition_bits = 16\ncodec = 'zstd'\n\
        [[asset]]\nname = 'close'\nfile = 'a.obj'\ntolerance = 0.01\n\
        [[asset]]\nname = 'plain'\nfile = 'a.obj'\n";
    let flags = Recipe { precision: "10".parse().ok().map(Precision::Bits), ..Recipe::default() };
    let told = settings(dir.path(), scene, flags);
    for settings in &told {
        assert!(settings.starts_with("position-bits 10,"), "{told:?}");
    }
    // What no flag says is the file's, and then the default.
    assert!(told[0].contains("codec zstd") && told[1].contains("codec range"), "{told:?}");
    let told = settings(dir.path(), scene, Recipe::default());
    assert!(told[0].starts_with("position-bits 16,") && told[1].starts_with("tolerance 0.01,"), "{told:?}");
    assert!(told[2].starts_with("position-bits 14,"), "{told:?}");
}
