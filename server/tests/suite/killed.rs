//! A killed preparation is resumed and gives the same pack.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use tempfile::TempDir;

use crate::landscape;

fn prepare(model: &Path, pack: &Path, threads: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-server"));
    command.arg("prepare").arg(model).arg("--output").arg(pack).args(["--threads", threads, "--quiet"]);
    command.arg("--keep-levels").stdout(Stdio::piped()).stderr(Stdio::null());
    command
}

/// The folders of finished levels beside a pack.
fn kept(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.filter(|path| path.is_dir()).collect()
}

#[test]
fn a_killed_preparation_is_resumed_and_gives_the_same_pack() {
    let dir = TempDir::new().unwrap();
    let model = dir.path().join("land.obj");
    std::fs::write(&model, landscape::obj(220)).unwrap();
    let whole = dir.path().join("whole.lsp");
    assert!(prepare(&model, &whole, "2").status().unwrap().success());
    assert!(kept(dir.path()).is_empty(), "nothing is left behind");

    let folder = dir.path().join("killed");
    std::fs::create_dir(&folder).unwrap();
    let pack = folder.join("land.lsp");
    // On a busy machine a run may end before it is seen to have a finished level.
    let killed = (0..20).any(|_| {
        let _ = std::fs::remove_file(&pack);
        let mut child = prepare(&model, &pack, "1").spawn().unwrap();
        while child.try_wait().unwrap().is_none() {
            if kept(&folder).iter().any(|levels| levels.join("0-end").exists()) {
                child.kill().unwrap();
                break;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        child.wait().unwrap();
        !pack.exists()
    });
    assert!(killed && kept(&folder).len() == 1, "every run ended before it could be killed");

    let output = prepare(&model, &pack, "2").output().unwrap();
    assert!(output.status.success());
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(told.contains("resumed from"), "{told}");
    assert!(kept(&folder).is_empty(), "nothing is left behind");
    assert!(std::fs::read(&pack).unwrap() == std::fs::read(&whole).unwrap(), "another pack");
}
