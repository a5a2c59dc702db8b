//! Slow stores: sessions continue during a read, and can end.
//!
//! In real time, because a paused clock stands still during a blocking read and timers would never fire. So every wait has
//! a time limit of its own.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Mutex, PoisonError};

use lodestream_protocol::source::{Reading, SceneSource, SourceError};
use lodestream_scene::description::{SceneHeader, ScenePage};

use tokio::time::timeout;

use super::*;

/// A scene with one blob whose read blocks until the test releases it.
struct BlockingScene {
    scene: MemoryScene,
    go: Mutex<Receiver<()>>,
    panics: bool,
}

const BLOCKED_BLOB: BlobId = BlobId::texture(0, 0, 0);

fn blocking_scene(panics: bool) -> (Arc<ServerState>, Sender<()>) {
    let (go, wait) = channel();
    let scene = BlockingScene { scene: MemoryScene::new(2, 1500, 9000), go: Mutex::new(wait), panics };
    (ServerState::new(Arc::new(scene), SessionSettings::default()), go)
}

impl SceneSource for BlockingScene {
    fn header(&self) -> &SceneHeader {
        self.scene.header()
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        self.scene.page(page)
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        self.scene.blob_len(id)
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        if *id == BLOCKED_BLOB {
            // An error means that the test has ended.
            let _ = self.go.lock().unwrap_or_else(PoisonError::into_inner).recv();
            assert!(!self.panics, "the panic of this test");
        }
        self.scene.read(id)
    }

    fn try_read(&self, id: &BlobId) -> Result<Reading, SourceError> {
        if *id == BLOCKED_BLOB { Ok(Reading::Pending) } else { self.read(id).map(Reading::Ready) }
    }
}

/// [`Client::next`], which must come.
async fn next(client: &mut Client<DuplexStream>) -> Option<ServerFrame> {
    timeout(REAL_TIME_LIMIT, client.next()).await.expect("the session waits for the read")
}

/// Reads until `count` blobs are complete.
async fn blobs(client: &mut Client<DuplexStream>, assembler: &mut Assembler, count: usize) {
    while assembler.complete.len() < count {
        if let ServerFrame::Piece(piece) = next(client).await.expect("closed before all came") {
            assembler.push(piece);
        }
    }
}

#[tokio::test]
async fn a_blocked_read_delays_no_other_blob() {
    let (state, go) = blocking_scene(false);
    let mut client = Client::in_memory(&state).await;
    client.send(&hello()).await;
    client.send(&want_textures(2)).await;
    let mut assembler = Assembler::default();
    // Two base meshes and all textures but one.
    blobs(&mut client, &mut assembler, 2 + 15).await;
    assert!(assembler.complete.iter().all(|(id, _)| *id != BLOCKED_BLOB));
    go.send(()).unwrap();
    blobs(&mut client, &mut assembler, 2 + 16).await;
    assert_eq!(assembler.complete.last().map(|(id, _)| *id), Some(BLOCKED_BLOB));
}

#[tokio::test]
async fn a_session_can_end_during_a_read() {
    let (state, go) = blocking_scene(false);
    let mut client = Client::in_memory(&state).await;
    client.send(&hello()).await;
    client.send(&want_textures(2)).await;
    blobs(&mut client, &mut Assembler::default(), 2 + 15).await;
    client.send(&ClientMessage::Bye).await;
    while next(&mut client).await.is_some() {}
    drop(client);
    let ended = timeout(REAL_TIME_LIMIT, state.all_sessions_ended()).await;
    assert!(ended.is_ok(), "the session waits for the read");
    drop(go);
}

#[tokio::test]
async fn a_panic_in_the_store_refuses_the_blob() {
    let (state, go) = blocking_scene(true);
    let mut client = Client::in_memory(&state).await;
    client.send(&hello()).await;
    client.send(&ClientMessage::Want(vec![Want::whole(BLOCKED_BLOB, 1)])).await;
    go.send(()).unwrap();
    loop {
        if let ServerFrame::Message(ServerMessage::Refused(refused)) =
            next(&mut client).await.expect("closed")
        {
            assert_eq!(refused.id, BLOCKED_BLOB);
            return;
        }
    }
}
