//! Packs damaged while they are served: the server reports them, and the viewer does not call a picture settled that
//! lacks some of their contents.

use std::path::Path;
use std::sync::Arc;

use lodestream_bake::scene::of_files;
use lodestream_daemon::SessionSettings;
use lodestream_store::BlobCache;

use crate::support::daemon::{Server, Transport};
use crate::support::scene::prepare_all;
use crate::support::shapes::write_scene;
use crate::support::viewer::{Viewer, config};

/// Serves the small scene, damages its packs, and checks metrics and the viewer's status.
fn damaged_by(damage: impl Fn(&Path)) {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let scene = of_files(&[write_scene(folder.path())]).unwrap();
    let packs = prepare_all(&scene, &cache);
    let paths: Vec<_> = packs.iter().map(|pack| pack.path().to_owned()).collect();
    // Only base meshes are in memory.
    let store = lodestream_bake::compose::open(&scene, packs, &BlobCache::new(256 << 20)).unwrap();
    let server = Server::start(Arc::new(store), SessionSettings::default());
    paths.iter().for_each(|path| damage(path));
    let mut viewer = Viewer::start(&server.address(Transport::WebSocket), config());
    let status =
        viewer.wait("an incomplete picture", |status| status.settled || status.stats.lacking_blobs > 0);
    assert!(!status.settled, "settled without what is damaged: {:?}", status.stats);
    let metrics = server.metrics();
    let unreadable = metrics.lines().find_map(|line| line.strip_prefix("lodestream_unreadable_blobs_total "));
    assert!(unreadable.is_some_and(|count| count.parse::<u64>().unwrap() > 0), "{unreadable:?}");
    server.assert_healthy();
}

#[test]
fn reads_of_packs_truncated_while_served_are_counted() {
    damaged_by(|path| {
        let file = std::fs::File::options().write(true).open(path).unwrap();
        let length = file.metadata().unwrap().len();
        file.set_len(length / 2).unwrap();
    });
}

#[test]
fn reads_of_packs_altered_while_served_are_counted() {
    damaged_by(|path| {
        let mut bytes = std::fs::read(path).unwrap();
        let half = bytes.len() / 2;
        bytes[half..].iter_mut().for_each(|byte| *byte ^= 0x55);
        std::fs::write(path, bytes).unwrap();
    });
}
