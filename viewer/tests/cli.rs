//! The viewer's command line: refused arguments, messages, exit codes.

#![allow(clippy::unwrap_used, reason = "test helpers without #[test] may unwrap, as tests may")]

use std::io::{Read as _, Write as _};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Runs the viewer with arguments that must be refused: exit code 2, nothing on standard output. Returns standard
/// error.
fn refused(arguments: &[&str], fragments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-viewer"));
    // Connection attempts are logged, but only the outcome is checked here. Graphics drivers complain on standard error
    // if XDG_RUNTIME_DIR is missing.
    command.args(arguments).env("RUST_LOG", "off").env_remove("XDG_RUNTIME_DIR");
    let output = command.output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert!(output.stdout.is_empty(), "{arguments:?}");
    assert!(message.starts_with("error: "), "{message}");
    for fragment in fragments {
        assert!(message.contains(fragment), "{message:?} lacks {fragment:?}");
    }
    message
}

#[test]
fn invalid_addresses_are_refused() {
    for (address, fragment) in [
        ("", "server address"),
        ("http://localhost:8080", "quic://HOST:PORT#sha256="),
        ("ws://localhost", "port"),
        ("ws://localhost:0", "port"),
        ("ws://localhost:70000", "port"),
        ("ws://:8080", "host"),
        ("quic://localhost:4433#4433", "sha256="),
        ("wss://localhost#spki-sha256=12", "64"),
        ("wss://localhost:0", "port"),
        ("quic://localhost:4433#sha256=12", "64"),
        ("quic://localhost:4433#sha256=xyz", "hexadecimal"),
    ] {
        refused(&[address], &[fragment]);
    }
}

#[test]
fn what_is_neither_a_file_nor_an_address_is_refused_as_both() {
    let message = refused(&["no such model.obj"], &["no file or folder", "model.obj", "server address"]);
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    refused(&["--headless", "--output", "x.png"], &["FILE | ADDRESS"]);
    refused(&["--exit-when-settled"], &["FILE | ADDRESS"]);
    let folder = tempfile::tempdir().unwrap();
    refused(&[folder.path().to_str().unwrap()], &["has no model"]);
    let notes = folder.path().join("notes.txt");
    std::fs::write(&notes, "no model").unwrap();
    let cache = folder.path().join("cache");
    let arguments =
        [notes.to_str().unwrap(), "--headless", "--output", "x.png", "--cache", cache.to_str().unwrap()];
    refused(&arguments, &["notes.txt"]);
    let settings = folder.path().join("viewer.toml");
    std::fs::write(&settings, "[keys]\ncut = \"C\"\n").unwrap();
    let address = ["ws://127.0.0.1:9", "--settings", settings.to_str().unwrap()];
    refused(&address, &["viewer.toml", "no action \"cut\""]);
}

#[test]
fn contradictory_options_are_refused() {
    let address = "ws://localhost:1";
    refused(&[address, "--watch"], &["--watch is for files"]);
    refused(&[address, "--share"], &["--share is for files"]);
    refused(&[address, address], &["name it alone"]);
    refused(&[address, "--headless"], &["--output"]);
    refused(&[address, "--window", "big"], &["WIDTHxHEIGHT"]);
    refused(&[address, "--camera", "eye=1,2"], &["eye"]);
    refused(&[address, "--pixel-error", "0"], &["--pixel-error"]);
    refused(&[address, "--timeout=-1"], &["--timeout"]);
    refused(&[address, "--pick", "3,4"], &["--headless"]);
    refused(&[address, "--hide", "3"], &["INSTANCE:PART"]);
    refused(&[address, "--tint", "0:1=orange"], &["INSTANCE:PART=RRGGBB"]);
}

#[test]
fn invalid_authority_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("ca.pem");
    let ca = file.to_str().unwrap();
    let headless = |address: &str, fragments: &[&str]| {
        refused(&[address, "--headless", "--output", "x.png", "--ca", ca], fragments);
    };
    headless("wss://localhost:1", &["--ca", ca, "No such file"]);
    std::fs::write(&file, "none").unwrap();
    headless("wss://localhost:1", &["--ca", ca, "no PEM certificate"]);
    headless("ws://localhost:1", &["--ca", "wss://"]);
    headless(&format!("quic://localhost:1#sha256={}", "ab".repeat(32)), &["--ca", "fingerprint"]);
}

/// Whether tests that open a graphics device are skipped; prints that they are.
fn without_gpu() -> bool {
    let skipped = std::env::var("LODESTREAM_SKIP_GPU").is_ok_and(|v| v == "1");
    if skipped {
        // Not `eprintln!`: the test runner would swallow it when the test "passes".
        let _ =
            writeln!(std::io::stderr(), "SKIPPED, NOT PASSED (LODESTREAM_SKIP_GPU=1): a test of the viewer");
    }
    skipped
}

#[test]
fn an_unreachable_server_is_an_error_of_one_line() {
    if without_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("x.png");
    // A free port, on which nothing listens.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let address = format!("ws://127.0.0.1:{port}");
    let message =
        refused(&[&address, "--headless", "--output", picture.to_str().unwrap()], &[&address, "running"]);
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    assert!(!picture.exists());
}

/// A viewer that is killed at the end of the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // Fails if it has ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_silent_peer_does_not_hang_the_viewer() {
    if without_gpu() {
        return;
    }
    // The system accepts connections to it; nothing ever answers.
    let silent = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("ws://{}", silent.local_addr().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("x.png");
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-viewer"));
    command.args([&address, "--headless", "--timeout", "2", "--output", picture.to_str().unwrap()]);
    command.env("RUST_LOG", "off").env_remove("XDG_RUNTIME_DIR");
    let mut viewer =
        Running(command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap());
    let mut stderr = viewer.0.stderr.take().unwrap();
    // It prints at most one line, so the pipe never fills. Opening a device may take long on a busy machine.
    let limit = Instant::now() + Duration::from_secs(120);
    let status = loop {
        if let Some(status) = viewer.0.try_wait().unwrap() {
            break status;
        }
        assert!(Instant::now() < limit, "the viewer still runs long after --timeout");
        std::thread::sleep(Duration::from_millis(50));
    };
    let mut message = String::new();
    stderr.read_to_string(&mut message).unwrap();
    assert_eq!(status.code(), Some(2), "{message}");
    // Which of these messages it is depends on how long opening the device took.
    let told = message.contains("nothing could be drawn within 2 s")
        || message.contains("is it a lodestream server");
    assert!(message.starts_with("error: ") && told, "{message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    assert!(!picture.exists());
    drop(silent);
}

#[test]
fn completions_and_the_manual_name_every_argument() {
    let run = |words: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-viewer"));
        command.arg("generate").args(words).env("RUST_LOG", "off").output().unwrap()
    };
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = String::from_utf8(run(&["completions", shell]).stdout).unwrap();
        assert!(script.contains("headless") && script.contains("token-file"), "{shell}: {script}");
    }
    let folder = tempfile::tempdir().unwrap();
    let pages = folder.path().join("man");
    assert!(run(&["man", pages.to_str().unwrap()]).status.success());
    let page = std::fs::read_to_string(pages.join("lodestream-viewer.1")).unwrap();
    assert!(page.contains("headless") && page.contains("streams a scene"), "{page}");
    assert_eq!(run(&["completions", "sh"]).status.code(), Some(2));
}
