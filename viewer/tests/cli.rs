//! The viewer as people run it: what it refuses, with which words and exit code.

// Helpers of tests are tests, whatever the lint thinks of functions without #[test].
#![allow(clippy::unwrap_used)]

use std::io::Write as _;
use std::process::Command;

/// Runs what must be refused: exit code 2, nothing on standard output; gives standard error.
fn refused(arguments: &[&str], fragments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-viewer"));
    // Attempts to connect are logged; here only the end counts. Graphics drivers would complain on standard error that
    // there is no XDG_RUNTIME_DIR.
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
fn addresses_that_are_none_are_refused() {
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
fn options_that_make_no_sense_are_refused() {
    let address = "ws://localhost:1";
    refused(&[address, "--headless"], &["--output"]);
    refused(&[address, "--window", "big"], &["WIDTHxHEIGHT"]);
    refused(&[address, "--camera", "eye=1,2"], &["eye"]);
    refused(&[address, "--pixel-error", "0"], &["--pixel-error"]);
    refused(&[address, "--timeout=-1"], &["--timeout"]);
}

#[test]
fn authorities_that_are_none_are_refused() {
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

#[test]
fn a_server_that_is_not_there_is_told_in_one_line() {
    if std::env::var("LODESTREAM_SKIP_GPU").is_ok_and(|v| v == "1") {
        // Not `eprintln!`: the test runner would swallow it when the test "passes".
        let _ =
            writeln!(std::io::stderr(), "SKIPPED, NOT PASSED (LODESTREAM_SKIP_GPU=1): a test of the viewer");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("x.png");
    // A port on which nobody listens: it was free a moment ago.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let address = format!("ws://127.0.0.1:{port}");
    let message =
        refused(&[&address, "--headless", "--output", picture.to_str().unwrap()], &[&address, "running"]);
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    assert!(!picture.exists());
}
