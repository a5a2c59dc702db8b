//! A published scene on a web server, and in a folder, is shown as a daemon's; faults of hosts are named.

pub(crate) mod host;
mod https;

use std::path::Path;
use std::sync::OnceLock;
use std::time::Duration;

use lodestream_bake::scene::of_files;
use lodestream_client::core::Stats;
use lodestream_daemon::SessionSettings;
use lodestream_scene::blob::BlobId;
use lodestream_server::catalogue::publish::publish;
use lodestream_store::Objects;

use crate::support::daemon::{Server, Transport};
use crate::support::picture::{comparison, draw, headless, keep, same};
use crate::support::scene::{TestScene, options};
use crate::support::shapes::write_scene;
use crate::support::viewer::{Viewer, config};
use host::{Fault, Host};

/// Time in which a fault must end streaming: a retried one takes some seconds.
const END: Duration = Duration::from_secs(60);

/// The small scene, published once.
pub(crate) fn published() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(publish_in(folder.path(), &write_scene(folder.path())), "small.lss");
        folder
    });
    // The folder lives as long as the process: a static is not dropped.
    Box::leak(folder.path().join("host").into_boxed_path())
}

/// Publishes a scene file into `host` in a folder; gives the scene's name there.
pub(crate) fn publish_in(folder: &Path, scene: &Path) -> String {
    let host = folder.join("host");
    std::fs::create_dir(&host).unwrap();
    let objects = Objects::of_folder(&host).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let scene = of_files(&[scene.to_owned()]).unwrap();
    runtime.block_on(publish(&scene, &objects, &folder.join("cache"), &options())).unwrap().name
}

/// A copy of the published scene, to be damaged.
pub(crate) fn copy() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("packs")).unwrap();
    for name in std::iter::once("small.lss".to_owned()).chain(packs()) {
        std::fs::copy(published().join(&name), folder.path().join(&name)).unwrap();
    }
    folder
}

/// Names of the packs.
pub(crate) fn packs() -> Vec<String> {
    let listed = std::fs::read_dir(published().join("packs")).unwrap();
    let mut names: Vec<_> =
        listed.map(|file| format!("packs/{}", file.unwrap().file_name().to_str().unwrap())).collect();
    names.sort();
    names
}

fn settle(host: &Host) -> Stats {
    Viewer::start(&host.scene(), config()).settle().stats
}

/// A plan of the simulator names it by path or address.
#[test]
fn the_simulator_reads_a_published_scene() {
    let source = TestScene::small().source();
    let open = |place: &str| {
        let choice = lodestream_scenario::plan::scene_choice(place).unwrap();
        lodestream_scenario::scene::open(&choice, None, Path::new(""), true)
    };
    let path = published().join("small.lss").display().to_string();
    for place in [path.clone(), format!("file:{path}")] {
        let opened = open(&place).unwrap();
        assert_eq!(opened.header().fingerprint, source.header().fingerprint);
        let chunks = |asset| source.page(0).unwrap().assets[asset as usize].chunk_count;
        let of_asset = |asset| {
            let chunks = (0..chunks(asset)).map(move |chunk| BlobId::chunk(asset, chunk));
            [BlobId::base(asset), BlobId::texture(asset, 0, 0)].into_iter().chain(chunks)
        };
        let mut count = 0;
        for id in (0..source.page(0).unwrap().assets.len() as u32).flat_map(of_asset) {
            if source.blob_len(&id).is_some() {
                assert_eq!(opened.read(&id).unwrap(), source.read(&id).unwrap(), "{id:?}");
                count += 1;
            }
        }
        assert!(count > 10, "{count}");
    }
    let folder = copy();
    std::fs::remove_file(folder.path().join(&packs()[0])).unwrap();
    let why = open(&folder.path().join("small.lss").display().to_string()).err().unwrap();
    assert!(format!("{why:#}").contains(&packs()[0]), "{why:#}");
}

#[test]
fn a_static_host_and_a_folder_show_what_a_daemon_shows() {
    let Some(mut headless) = headless() else { return };
    let server = Server::start(TestScene::small().source(), SessionSettings::default());
    let mut of_server = Viewer::start(&server.address(Transport::WebSocket), config());
    let expected = of_server.settle().stats;
    let picture = draw(&mut headless, of_server.changes);
    let host = Host::start(published());
    let file = format!("file:{}/small.lss", published().display()).parse().unwrap();
    for (address, name) in [(host.scene(), "static-host"), (file, "file")] {
        let mut viewer = Viewer::start(&address, config());
        let stats = viewer.settle().stats;
        assert_eq!((stats.faces, stats.applied_chunks), (expected.faces, expected.applied_chunks), "{name}");
        assert_eq!((stats.decode_failures, stats.refused, stats.connections), (0, 0, 1), "{name}");
        assert!(stats.milestones.first_frame.is_some() && stats.requests <= 40, "{name}: {stats:?}");
        let drawn = draw(&mut headless, viewer.changes);
        keep(&drawn, name);
        let found = comparison(&drawn, &picture);
        assert!(same(&found), "{name}: {found:?}");
    }
    // Six requests are in flight at most; a host may see the end of an aborted one late.
    assert!(host.most_connections() <= 8, "{} connections", host.most_connections());
    assert!(host.requests().len() <= 40, "{:?}", host.requests());
}

#[test]
fn redirects_and_closed_connections_cost_only_time() {
    let expected = settle(&Host::start(published())).faces;
    for fault in [Fault::Redirect, Fault::Close] {
        let host = Host::start(published()).with(fault);
        let stats = settle(&host);
        assert_eq!((stats.faces, stats.connections), (expected, 1), "{fault:?}");
    }
}

#[test]
fn hosts_that_cannot_serve_ranges_end_streaming_with_what_to_do() {
    for (fault, says) in [
        (Fault::NoRanges, "does not answer range requests; use a server that does"),
        (Fault::Gzip, "switch compression off"),
    ] {
        for packs in [false, true] {
            let host = Host::start(published()).with(fault);
            let host = if packs { host.in_packs() } else { host };
            let why = Viewer::start(&host.scene(), config()).end(END);
            assert!(why.contains(says), "{fault:?} of packs: {packs}: {why}");
            assert!(!packs || why.contains("packs/"), "{why}");
        }
    }
}

#[test]
fn faults_that_pass_are_overcome_once_they_have() {
    for fault in [Fault::OtherRange, Fault::Short, Fault::HangUp] {
        let host = Host::start(published()).with(fault).in_packs();
        let mut viewer = Viewer::start(&host.scene(), config());
        let status = viewer.wait("a message", |status| status.message.is_some() && status.stats.faces > 0);
        let message = status.message.unwrap();
        assert!(!status.settled && message.contains("packs/"), "{fault:?}: {message}");
        host.set(None);
        let settled = viewer.settle();
        assert_eq!((settled.stats.connections, settled.stats.decode_failures), (1, 0), "{fault:?}");
    }
}

#[test]
fn missing_truncated_and_damaged_scenes_end_streaming_with_what_to_do() {
    let whole = std::fs::read(published().join("small.lss")).unwrap();
    let end = |bytes: Option<&[u8]>| {
        let folder = copy();
        match bytes {
            Some(bytes) => std::fs::write(folder.path().join("small.lss"), bytes).unwrap(),
            None => std::fs::remove_file(folder.path().join("small.lss")).unwrap(),
        }
        let host = Host::start(folder.path());
        Viewer::start(&host.scene(), config()).end(END)
    };
    assert!(end(None).contains("not there (status 404); publish the scene again, or correct the address"));
    assert!(end(Some(&whole[..whole.len() / 2])).contains("truncated"));
    assert!(end(Some(b"<html>moved</html>")).contains("not a published scene"));
    let mut damaged = whole;
    damaged[60] ^= 1;
    assert!(end(Some(&damaged)).contains("the hash of its opening does not match"));
}

#[test]
fn missing_truncated_and_damaged_packs_are_named_and_the_rest_is_shown() {
    let expected = settle(&Host::start(published()));
    for (what, says) in
        [("missing", "not there"), ("truncated", "truncated"), ("damaged", "do not have their hash")]
    {
        let folder = copy();
        let pack =
            packs().into_iter().max_by_key(|name| std::fs::metadata(published().join(name)).unwrap().len());
        let path = folder.path().join(pack.as_ref().unwrap());
        let mut bytes = std::fs::read(&path).unwrap();
        match what {
            "missing" => std::fs::remove_file(&path).unwrap(),
            "truncated" => std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap(),
            _ => {
                bytes.iter_mut().step_by(50).for_each(|byte| *byte ^= 4);
                std::fs::write(&path, &bytes).unwrap();
            }
        }
        let host = Host::start(folder.path());
        let mut viewer = Viewer::start(&host.scene(), config());
        let mut messages = Vec::new();
        let status = viewer.wait("all but one pack", |status| {
            messages.extend(status.message.clone());
            status.stats.lacking_blobs > 0
        });
        assert!(!status.settled && status.stats.decode_failures == 0, "{what}: {:?}", status.stats);
        assert!(status.stats.faces < expected.faces && status.stats.applied_chunks > 0, "{what}");
        let name = pack.unwrap();
        assert!(messages.iter().any(|why| why.contains(&name) && why.contains(says)), "{what}: {messages:?}");
        // Put back, it is read.
        std::fs::copy(published().join(&name), &path).unwrap();
        assert_eq!(viewer.settle().stats.faces, expected.faces, "{what}");
    }
}
