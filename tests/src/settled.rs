//! A streamed scene ends up looking like the model.

use std::sync::Arc;

use lodestream_daemon::SessionSettings;
use lodestream_scene::BlobId;

use crate::support::daemon::{Server, Transport};
use crate::support::picture::{comparison, draw, headless, keep, same};
use crate::support::scene::{Lacking, TestScene};
use crate::support::viewer::{Viewer, config};

/// Checks the whole path from pack to picture: a settled client shows the same as the model drawn locally with every
/// chunk applied. With one chunk withheld the comparison must fail, so it would detect a lost chunk.
#[test]
fn the_settled_picture_equals_that_of_the_complete_model() {
    let Some(mut headless) = headless() else { return };
    let scene = TestScene::small();
    let server = Server::start(scene.source(), SessionSettings::default());
    let whole = draw(&mut headless, scene.whole());
    keep(&whole, "whole");
    for transport in Transport::BOTH {
        let mut viewer = Viewer::start(&server.address(transport), config());
        let status = viewer.settle();
        let stats = &status.stats;
        assert_eq!((stats.decode_failures, stats.refused), (0, 0), "{stats:?}");
        assert!(stats.applied_chunks > 0 && stats.texture_levels > 0, "{stats:?}");
        // Distant objects stay coarse: the view determines when the picture is settled, not the end of the data.
        assert!(stats.faces < scene.faces(), "{} of {} faces", stats.faces, scene.faces());
        let settled = draw(&mut headless, viewer.changes);
        keep(&settled, &format!("settled-{transport:?}"));
        let found = comparison(&settled, &whole);
        println!("{transport:?}: {found:?}, {} bytes", stats.transport_bytes);
        assert!(found.covered >= 0.2, "{found:?}");
        assert!(same(&found), "{transport:?}: {found:?}");
    }

    // The ball's first chunk: without it, all refinements of its region are missing too.
    let lacking = Lacking { scene: scene.source(), blob: BlobId::chunk(scene.asset("ball"), 0) };
    let other = Server::start(Arc::new(lacking), SessionSettings::default());
    let mut viewer = Viewer::start(&other.address(Transport::WebSocket), config());
    let status = viewer.wait("all but one chunk", |status| status.stats.lacking_blobs == 1);
    // The unrequested push is refused too, however often it is tried.
    assert!(!status.settled && (1..=4).contains(&status.stats.refused), "{:?}", status.stats);
    let lacking = draw(&mut headless, viewer.changes);
    keep(&lacking, "withheld");
    let found = comparison(&lacking, &whole);
    println!("withheld: {found:?}");
    assert!(!same(&found), "the comparison does not detect a missing chunk: {found:?}");
    server.assert_healthy();
    other.assert_healthy();
}
