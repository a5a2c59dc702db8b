//! `wss://` and QUIC with certificates: validation, and exchange of a certificate.

use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use lodestream_client::net::{Address, Authorities, Server as Target};
use lodestream_daemon::SessionSettings;
use lodestream_protocol::source::SceneSource;

use crate::support::LIMIT;
use crate::support::authority::{Authority, DAY, Files, new_key};
use crate::support::daemon::Server;
use crate::support::scene::TestScene;
use crate::support::viewer::{Viewer, config};

/// The transports with certificates.
const BOTH: [&str; 2] = ["quic", "wss"];

fn scene() -> Arc<dyn SceneSource> {
    TestScene::small().source()
}

/// A daemon with TLS on its HTTP port, with a self-signed certificate or one from files.
fn serve(files: Option<&Files>) -> Server {
    Server::start_with(scene(), SessionSettings::default(), |options| {
        options.http_tls = true;
        options.certificate = files.map(|files| (files.chain.clone(), files.key.clone()));
    })
}

/// The address without its fingerprint, with another host name.
fn named(address: &Address, name: &str) -> Address {
    Address { host: name.into(), pin: None, ..address.clone() }
}

fn trusting(address: Address, authorities: &Authorities) -> Target {
    let mut target = Target::from(address);
    target.authorities = authorities.clone();
    target
}

fn first_frame(target: impl Into<Target>) -> Viewer {
    let mut viewer = Viewer::start_at(target.into(), config());
    viewer.wait("a first frame", |status| status.stats.milestones.first_frame.is_some());
    viewer
}

/// The message of a refused connection, which must come at the first attempt.
fn refused(target: impl Into<Target>) -> String {
    Viewer::start_at(target.into(), config()).end(LIMIT)
}

#[test]
fn wss_works_with_the_printed_address() {
    let server = serve(None);
    let url = server.url_of("wss");
    assert!(url.contains("/#spki-sha256="), "{url}");
    let mut viewer = first_frame(server.address_of("wss"));
    let status = viewer.settle();
    assert!(status.stats.applied_chunks > 0, "{:?}", status.stats);
    server.assert_healthy();
}

#[test]
fn a_certificate_that_is_not_pinned_is_refused_with_the_reason() {
    let server = serve(None);
    let other = serve(None);
    for transport in BOTH {
        let address = Address { pin: other.address_of(transport).pin, ..server.address_of(transport) };
        let why = refused(address);
        assert!(why.contains("another key") && why.contains("#spki-sha256="), "{transport}: {why}");
    }
    // Servers without TLS and with TLS only.
    let plain = Server::start(scene(), SessionSettings::default());
    let mut address = server.address_of("wss");
    address.port = plain.http_address().port();
    let why = refused(address);
    assert!(why.contains("does not use TLS") && why.contains("ws://"), "{why}");
    let address: Address = format!("ws://{}", server.http_address()).parse().unwrap();
    let why = refused(address);
    assert!(why.contains("wss://"), "{why}");
    server.assert_healthy();
}

#[test]
fn an_authoritys_certificate_is_valid_for_its_names_only() {
    let folder = tempfile::tempdir().unwrap();
    let (files, ours) = (Files::within(folder.path()), Authority::new("ours"));
    ours.write(&files, "localhost", &new_key(), SystemTime::now() + DAY);
    let server = serve(Some(&files));
    for transport in BOTH {
        let address = named(&server.address_of(transport), "localhost");
        first_frame(trusting(address.clone(), &ours.trusted()));
        let why = refused(trusting(address, &Authority::new("another").trusted()));
        assert!(
            why.contains("no trusted authority") && why.contains("authority's certificate"),
            "{transport}: {why}"
        );
        let why = refused(trusting(named(&server.address_of(transport), "127.0.0.1"), &ours.trusted()));
        assert!(why.contains("another name") && why.contains("localhost"), "{transport}: {why}");
    }
    server.assert_healthy();
}

#[test]
fn an_expired_certificate_is_refused_where_its_authority_is_trusted() {
    let folder = tempfile::tempdir().unwrap();
    let (files, ours) = (Files::within(folder.path()), Authority::new("ours"));
    ours.write(&files, "localhost", &new_key(), SystemTime::now() - DAY / 2);
    let server = serve(Some(&files));
    for transport in BOTH {
        let address = server.address_of(transport);
        let why = refused(trusting(named(&address, "localhost"), &ours.trusted()));
        assert!(why.contains("has expired") && why.contains("renew"), "{transport}: {why}");
        // The dates do not matter if the address has a fingerprint.
        first_frame(address);
    }
}

/// Waits until the metrics contain a line.
fn wait_for(server: &Server, line: &str) {
    let until = Instant::now() + LIMIT;
    while !server.metrics().lines().any(|found| found == line) {
        assert!(Instant::now() < until, "{line} did not appear: {}", server.metrics());
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn wait_for_end(server: &Server, end: SystemTime) {
    let seconds = end.duration_since(SystemTime::UNIX_EPOCH).unwrap().as_secs();
    wait_for(server, &format!("lodestream_certificate_not_after_seconds {seconds}"));
}

#[test]
fn a_certificate_is_exchanged_while_sessions_run() {
    let folder = tempfile::tempdir().unwrap();
    let (files, ours, now) = (Files::within(folder.path()), Authority::new("ours"), SystemTime::now());
    let key = new_key();
    ours.write(&files, "localhost", &key, now + DAY);
    let server = serve(Some(&files));
    let pinned = BOTH.map(|transport| server.address_of(transport));
    assert!(server.url_of("quic").contains("#spki-sha256="), "{}", server.url_of("quic"));
    let mut running: Vec<Viewer> = pinned.iter().cloned().map(first_frame).collect();

    // Renewed for the same key: addresses with its fingerprint stay valid.
    ours.write(&files, "localhost", &key, now + 2 * DAY);
    server.reload();
    wait_for_end(&server, now + 2 * DAY);
    pinned.iter().cloned().for_each(|address| drop(first_frame(address)));

    // A certificate without its key is refused with a message; the old one stays.
    let chain = std::fs::read(&files.chain).unwrap();
    let other = new_key();
    std::fs::write(&files.key, other.serialize_pem()).unwrap();
    server.reload();
    wait_for(&server, "lodestream_certificates_refused_total 1");
    std::fs::write(&files.chain, "nonsense").unwrap();
    server.reload();
    wait_for(&server, "lodestream_certificates_refused_total 2");
    std::fs::remove_file(&files.chain).unwrap();
    server.reload();
    wait_for(&server, "lodestream_certificates_refused_total 3");
    pinned.iter().cloned().for_each(|address| drop(first_frame(address)));

    // Another key: addresses with the old fingerprint are refused, those that trust the authority are not.
    std::fs::write(&files.chain, chain).unwrap();
    ours.write(&files, "localhost", &other, now + 3 * DAY);
    server.reload();
    wait_for_end(&server, now + 3 * DAY);
    for (transport, address) in BOTH.into_iter().zip(pinned) {
        let why = refused(address.clone());
        assert!(why.contains("another key") && why.contains("#spki-sha256="), "{transport}: {why}");
        first_frame(trusting(named(&address, "localhost"), &ours.trusted()));
    }

    // No session was ended.
    for viewer in &mut running {
        let status = viewer.settle();
        assert_eq!(status.stats.connections, 1, "{:?}", status.stats);
    }
    server.assert_healthy();
}
