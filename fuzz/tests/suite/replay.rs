//! Replays every committed input and every current seed of every target.

use std::path::{Path, PathBuf};

use lodestream_fuzz::{seeds, targets};

fn corpus(target: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|f| f.unwrap().path()).collect();
    files.sort();
    files
}

fn replay(target: &str) {
    let (_, run) = targets::ALL.into_iter().find(|(name, _)| *name == target).unwrap();
    for (file, bytes) in seeds::of(target) {
        assert!(run(&bytes), "{target} refuses its seed {file}");
        // A truncated seed may be refused or not, but must not be a finding.
        run(&bytes[..bytes.len() / 2]);
    }
    let files = corpus(target);
    assert!(files.len() >= 5, "{target}: only {} inputs", files.len());
    for file in files {
        println!("{}", file.display());
        run(&std::fs::read(&file).unwrap());
    }
}

#[test]
fn pack_reader() {
    replay("pack_reader");
}

#[test]
fn base_decoder() {
    replay("base_decoder");
}

#[test]
fn chunk_decoder() {
    replay("chunk_decoder");
}

#[test]
fn apply_undo() {
    replay("apply_undo");
}

#[test]
fn obj_import() {
    replay("obj_import");
}

#[test]
fn gltf_import() {
    replay("gltf_import");
}

#[test]
fn gltf_compressed() {
    replay("gltf_compressed");
}

#[test]
fn image_import() {
    replay("image_import");
}

#[test]
fn ply_import() {
    replay("ply_import");
}

#[test]
fn messages() {
    replay("messages");
}

#[test]
fn terrain() {
    replay("terrain");
}

#[test]
fn punctual_lights() {
    replay("punctual_lights");
}

#[test]
fn parts() {
    replay("parts");
}

#[test]
fn corpora_stay_small() {
    let (mut files, mut bytes) = (0, 0);
    for (name, _) in targets::ALL {
        for file in corpus(name) {
            files += 1;
            bytes += std::fs::metadata(&file).unwrap().len();
        }
    }
    assert!(files <= 600 && bytes <= 1 << 20, "{files} files of {bytes} bytes");
}

#[test]
fn scene_object() {
    replay("scene_object");
}

#[test]
fn range_session() {
    replay("range_session");
}
