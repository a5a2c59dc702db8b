//! Dependencies of each crate, from `cargo tree`.

use std::collections::BTreeSet;
use std::process::Command;

/// Names of all crates that a package's library depends on, with arguments for features.
fn needs(package: &str, arguments: &[&str]) -> BTreeSet<String> {
    let mut command = Command::new(env!("CARGO"));
    command.current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    command.args([
        "tree",
        "--offline",
        "--locked",
        "--edges",
        "normal,build",
        "--prefix",
        "none",
        "-p",
        package,
    ]);
    let output = command.args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let names = String::from_utf8(output.stdout).unwrap();
    let names: BTreeSet<String> =
        names.lines().filter_map(|line| line.split_whitespace().next()).map(str::to_owned).collect();
    // Guards against another output format, in which no name would be found.
    assert!(names.contains(package), "{names:?}");
    names
}

/// Asserts that a package depends on none of these crates.
fn lacks(package: &str, arguments: &[&str], none: &[&str]) {
    let needs = needs(package, arguments);
    for name in none {
        assert!(!needs.contains(*name), "{package} {arguments:?} needs {name}");
    }
}

#[test]
fn an_embedder_of_the_client_compiles_no_window_and_no_renderer() {
    let graphics = ["wgpu", "winit", "egui", "clap", "lodestream-render", "lodestream-server"];
    lacks("lodestream-client", &[], &graphics);
    assert!(needs("lodestream-client", &[]).contains("tokio"));
    let network = ["tokio", "quinn", "rustls", "ring", "tungstenite", "tokio-tungstenite", "socket2"];
    lacks("lodestream-client", &["--no-default-features"], &network);
    // Nor C. (`cc` is a dependency of BLAKE3, which does not call it with its feature `pure`.)
    lacks("lodestream-client", &["--no-default-features"], &["zstd", "zstd-sys"]);
    lacks("lodestream-client", &["--no-default-features", "--features", "quic"], &["tokio-tungstenite"]);
    lacks("lodestream-client", &["--no-default-features", "--features", "websocket"], &["quinn", "rustls"]);
    lacks(
        "lodestream-client",
        &["--no-default-features", "--features", "tls"],
        &["quinn", "aws-lc-rs", "openssl"],
    );
}

#[test]
fn an_embedder_of_the_renderer_compiles_no_network() {
    let network = ["tokio", "quinn", "rustls", "tungstenite", "winit", "egui", "clap"];
    lacks("lodestream-render", &[], &[&network[..], &["lodestream-client"]].concat());
    lacks("lodestream-render", &["--features", "client"], &network);
    assert!(needs("lodestream-render", &["--features", "client"]).contains("lodestream-client"));
}

/// Nor C: only tests encode with meshoptimizer's library.
#[test]
fn the_importer_without_its_draco_feature_compiles_no_draco() {
    assert!(needs("lodestream-import", &[]).contains("draco-core"));
    lacks("lodestream-import", &["--no-default-features"], &["draco-core"]);
    lacks("lodestream-import", &[], &["meshopt", "zstd-sys", "tokio", "clap"]);
}

/// Clients of object stores bring a C library for TLS by default.
#[test]
fn the_server_has_one_library_of_tls() {
    lacks("lodestream-server", &[], &["aws-lc-rs", "aws-lc-sys", "openssl", "native-tls", "wgpu", "winit"]);
    assert!(needs("lodestream-server", &[]).contains("object_store"));
}

#[test]
fn the_simulated_links_depend_on_no_other_crate_of_the_workspace() {
    let ours: Vec<String> = needs("lodestream-netsim", &[])
        .into_iter()
        .filter(|name| name.starts_with("lodestream-") && name != "lodestream-netsim")
        .collect();
    assert!(ours.is_empty(), "{ours:?}");
}
