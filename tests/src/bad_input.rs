//! Wrong input by users, and packs damaged on disk. The command lines themselves are tested beside the programs.

use std::fs::OpenOptions;
use std::io::{Seek as _, SeekFrom, Write as _};
use std::path::Path;
use std::time::Duration;

use lodestream_bake::scene::of_files;
use lodestream_daemon::SessionSettings;
use lodestream_protocol::source::{SceneSource as _, SourceError};
use lodestream_scene::BlobId;

use crate::support::daemon::{Server, Transport};
use crate::support::scene::{TestScene, prepare_all};
use crate::support::shapes::ball;
use crate::support::viewer::{Viewer, config};

/// Checks that a server with another certificate than the address names is refused, with the remedy in the message.
#[test]
fn a_wrong_fingerprint_is_reported_in_one_line() {
    let server = Server::start(TestScene::small().source(), SessionSettings::default());
    let good = server.url(Transport::Quic);
    let (rest, last) = good.split_at(good.len() - 1);
    let other = if last == "0" { "1" } else { "0" };
    let mut viewer = Viewer::start(&format!("{rest}{other}").parse().unwrap(), config());
    let end = viewer.end(Duration::from_secs(50));
    assert!(end.contains("certificate") && end.contains("#spki-sha256="), "{end}");
    assert_eq!(end.lines().count(), 1, "{end}");
    server.assert_healthy();
}

fn overwrite(pack: &Path, at: usize, bytes: &[u8]) {
    let mut file = OpenOptions::new().write(true).open(pack).unwrap();
    file.seek(SeekFrom::Start(at as u64)).unwrap();
    file.write_all(bytes).unwrap();
}

/// Checks that a chunk damaged on disk under a running server is refused while everything else is served, and that the
/// client gets the chunk once the file is restored.
#[test]
fn a_chunk_damaged_on_disk_is_refused_until_it_is_restored() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("ball.obj");
    std::fs::write(&model, ball(30, 40)).unwrap();
    let scene = of_files(&[model]).unwrap();
    let cache = folder.path().join("cache");
    let opened = TestScene::open(&scene, prepare_all(&scene, &cache));
    let pack = std::fs::read_dir(&cache).unwrap().next().unwrap().unwrap().path();

    // In the middle of the first chunk, on which others depend.
    let (chunk, whole) = (&opened.assets[0].chunks[0], std::fs::read(&pack).unwrap());
    let start = whole.windows(chunk.len()).position(|window| window == chunk).unwrap();
    let at = start + chunk.len() / 2;
    overwrite(&pack, at, &[whole[at] ^ 1]);
    let read = opened.store.read(&BlobId::chunk(0, 0));
    assert!(matches!(read, Err(SourceError::Unreadable { .. })), "{read:?}");

    let server = Server::start(opened.source(), SessionSettings::default());
    let mut viewer = Viewer::start(&server.address(Transport::WebSocket), config());
    let status = viewer.wait("a refusal", |s| s.stats.refused > 0 && s.stats.faces > 0);
    assert_eq!(status.stats.decode_failures, 0, "{:?}", status.stats);
    assert!(status.stats.milestones.first_frame.is_some());
    server.assert_healthy();

    overwrite(&pack, at, &whole[at..=at]);
    let stats = viewer.settle().stats;
    assert!(stats.applied_chunks > 0 && stats.connections == 1, "{stats:?}");
    server.assert_healthy();
}
