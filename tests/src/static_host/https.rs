//! A published scene over `https://`: what the certificate must be, and what is said where it is not.

use std::collections::BTreeMap;
use std::process::Command;
use std::time::SystemTime;

use lodestream_client::net::{Address, Authorities, Server};
use lodestream_scene::blob::BlobId;

use super::host::Host;
use super::{END, published};
use crate::support::authority::{Authority, DAY, Files, new_key};
use crate::support::program::{Program, program};
use crate::support::viewer::{Viewer, config};

/// A web server with a certificate that an authority of ours has signed for "localhost".
struct Secure {
    host: Host,
    authority: Authority,
    files: Files,
    folder: tempfile::TempDir,
}

impl Secure {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (files, authority) = (Files::within(folder.path()), Authority::new("ours"));
        authority.write(&files, "localhost", &new_key(), SystemTime::now() + DAY);
        Self { host: Host::start_tls(published(), &files), authority, files, folder }
    }

    /// A file of authorities, as `--ca` takes it.
    fn list_of(&self, authority: &Authority, name: &str) -> String {
        let path = self.folder.path().join(name);
        std::fs::write(&path, authority.pem()).unwrap();
        path.to_str().unwrap().to_owned()
    }
}

fn trusting(address: Address, authorities: &Authorities) -> Server {
    let mut server = Server::from(address);
    server.authorities = authorities.clone();
    server
}

/// Bytes of each blob that the settled picture uses, and the number of faces.
fn settled(server: Server) -> (BTreeMap<BlobId, u64>, u64) {
    let mut config = config();
    config.track_received = true;
    let mut viewer = Viewer::start_at(server, config);
    let stats = viewer.settle().stats;
    assert_eq!((stats.decode_failures, stats.refused, stats.connections), (0, 0, 1), "{stats:?}");
    let used = viewer.ask(|core| core.received().iter().map(|(id, bytes)| (*id, bytes.used_bytes)).collect());
    (used, stats.faces)
}

#[test]
fn a_trusted_certificate_gives_the_same_bytes_as_plain_http() {
    let (secure, plain) = (Secure::start(), Host::start(published()));
    let expected = settled(plain.scene().into());
    assert!(expected.0.values().any(|used| *used > 0), "{expected:?}");
    assert_eq!(settled(trusting(secure.host.scene(), &secure.authority.trusted())), expected, "an authority");
    // By its fingerprint: any name will do.
    let pin = secure.files.pin();
    let url = format!("https://{}/small.lss#sha256={pin}", secure.host.address);
    assert_eq!(settled(url.parse().unwrap()), expected, "a fingerprint");
}

#[test]
fn a_certificate_that_is_not_trusted_is_refused_at_once_with_what_to_do() {
    let secure = Secure::start();
    let refused = |server| Viewer::start_at(server, config()).end(END);
    let another = Authority::new("another").trusted();
    let why = refused(trusting(secure.host.scene(), &another));
    assert!(why.contains("no trusted authority") && why.contains("--ca FILE"), "{why}");
    let by_number = format!("https://{}/small.lss", secure.host.address).parse().unwrap();
    let why = refused(trusting(by_number, &secure.authority.trusted()));
    assert!(why.contains("another name") && why.contains("localhost"), "{why}");
    let url = format!("{}#sha256={}", secure.host.url("small.lss"), "00".repeat(32));
    let why = refused(url.parse().unwrap());
    assert!(why.contains("another certificate"), "{why}");
    // Another attempt could not help.
    assert_eq!((secure.host.connections(), secure.host.requests()), (3, Vec::new()));

    let plain = Host::start(published());
    let url = format!("https://{}/small.lss", plain.address).parse().unwrap();
    let why = refused(trusting(url, &secure.authority.trusted()));
    assert!(why.contains("does not use TLS") && why.contains("http://"), "{why}");
}

#[test]
fn the_viewer_trusts_the_authorities_of_a_file() {
    let secure = Secure::start();
    let picture = secure.folder.path().join("picture.png");
    let run = |address: &str, ca: &str| Program::headless(address, &picture, &["--ca", ca]).end();
    let ours = secure.list_of(&secure.authority, "ours.pem");
    let address = secure.host.url("small.lss");

    let output = run(&address, &secure.list_of(&Authority::new("another"), "another.pem"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("no trusted authority") && said.contains("--ca FILE"), "{said}");
    assert!(output.status.code() == Some(2) && !picture.exists(), "{output:?}");

    let output = run(&address.replace("https", "http"), &ours);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && said.contains("write https://"), "{output:?}");

    if std::env::var("LODESTREAM_SKIP_GPU").is_ok_and(|skip| skip == "1") {
        return;
    }
    let output = run(&address, &ours);
    assert!(output.status.success() && picture.exists(), "{output:?}");
}

/// It reads published scenes as the server reads stores: the system's authorities, or those of the environment.
#[test]
fn the_simulator_trusts_the_authorities_of_the_environment() {
    let secure = Secure::start();
    let plan = secure.folder.path().join("plan.toml");
    let scene = secure.host.url("small.lss");
    let text = format!(
        "scene = \"{scene}\"\nviewport_px = [64, 36]\nttq_px = [16]\ntime_limit_s = 60\n[[sweep]]\ntransport = \"ws\"\n\
         rate_bits_per_s = [8_000_000]\nrtt_ms = [20]\nloss = [0]\nqueue_bytes = 65536\n"
    );
    std::fs::write(&plan, text).unwrap();
    let results = secure.folder.path().join("results");
    let run = |authorities: &str| {
        let mut command = Command::new(program("lodestream-sim"));
        command.arg("run").arg(&plan).args(["--seed", "1", "-o"]).arg(&results);
        command.env("SSL_CERT_FILE", authorities).env_remove("SSL_CERT_DIR").output().unwrap()
    };
    let output = run(&secure.list_of(&Authority::new("another"), "another.pem"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains(&scene) && said.contains("SSL_CERT_FILE"), "{said}");
    let output = run(&secure.list_of(&secure.authority, "ours.pem"));
    assert!(output.status.success() && results.join("results.csv").exists(), "{output:?}");
}
