//! Real models, which are not part of the project: `LODESTREAM_MODELS=DIR cargo test --release
//! -p lodestream-server --test models -- --nocapture` prepares and checks every OBJ file of a folder.

// Helpers of tests are tests, whatever the lint thinks of functions without #[test].
#![allow(clippy::unwrap_used)]

use std::path::PathBuf;
use std::process::Command;

use tempfile::TempDir;

const RANDOM_SETS: &str = "200";

fn run(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_lodestream-server")).args(arguments).output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {error}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn every_model_prepares_and_passes_the_check() {
    let Some(folder) = std::env::var_os("LODESTREAM_MODELS") else {
        println!("skipped: LODESTREAM_MODELS names no folder of OBJ files");
        return;
    };
    let mut models: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|f| f.unwrap().path()).collect();
    models.retain(|path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj")));
    models.sort();
    assert!(!models.is_empty(), "no OBJ file in LODESTREAM_MODELS");
    let dir = TempDir::new().unwrap();
    for model in models {
        let pack = dir.path().join("model.lsp");
        let (model, pack) = (model.to_str().unwrap(), pack.to_str().unwrap());
        let report = run(&["prepare", model, "-o", pack, "--quiet"]);
        println!("{model}: {}", report.split_once(": ").map_or("", |(_, text)| text.trim_end()));
        let check = run(&["check", pack, "--random-sets", RANDOM_SETS, "--seed", "1"]);
        assert_eq!(
            check,
            format!("sets {RANDOM_SETS} cracks 0 order-dependent 0 undo-errors 0\n"),
            "{model}"
        );
        let fields: serde_json::Value = serde_json::from_str(&run(&["inspect", pack, "--json"])).unwrap();
        let (root, diagonal) = (fields["root_error"].as_f64().unwrap(), fields["diagonal"].as_f64().unwrap());
        println!(
            "  base {} bytes, {} faces, root error {:.2} % of the diagonal, {} chunks in {} levels",
            fields["base_bytes"],
            fields["base_faces"],
            100.0 * root / diagonal,
            fields["chunks"],
            fields["levels"]
        );
        assert!(root <= 0.05 * diagonal, "{model}: root error {root} of {diagonal}");
    }
}
