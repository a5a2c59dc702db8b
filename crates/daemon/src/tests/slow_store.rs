//! Stores that take their time: sessions go on, and end.
//!
//! In real time: a paused clock stands still for as long as a blocking read is under way, and whatever
//! waits for a timer meanwhile would wait for ever. So every wait here has a limit of its own.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Mutex, PoisonError};

use lodestream_protocol::source::{Reading, SceneSource, SourceError};
use lodestream_scene::description::{SceneHeader, ScenePage};

use tokio::time::timeout;

use super::*;

/// A scene one of whose blobs is read only when the test says so, on a thread that waits for it.
struct Held {
    scene: MemoryScene,
    go: Mutex<Receiver<()>>,
    panics: bool,
}

const HELD: BlobId = BlobId::texture(0, 0, 0);

fn held(panics: bool) -> (Arc<ServerState>, Sender<()>) {
    let (go, wait) = channel();
    let scene = Held { scene: MemoryScene::new(2, 1500, 9000), go: Mutex::new(wait), panics };
    (ServerState::new(Arc::new(scene), SessionSettings::default()), go)
}

impl SceneSource for Held {
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
        if *id == HELD {
            // An error means that the test is over.
            let _ = self.go.lock().unwrap_or_else(PoisonError::into_inner).recv();
            assert!(!self.panics, "as the test wants it");
        }
        self.scene.read(id)
    }

    fn try_read(&self, id: &BlobId) -> Result<Reading, SourceError> {
        if *id == HELD { Ok(Reading::Pending) } else { self.read(id).map(Reading::Ready) }
    }
}

/// [`Client::next`], which must come.
async fn next(client: &mut Client<DuplexStream>) -> Option<ServerFrame> {
    timeout(REAL_TIME_LIMIT, client.next()).await.expect("the session waits for the read")
}

/// Reads until so many blobs are complete.
async fn blobs(client: &mut Client<DuplexStream>, assembler: &mut Assembler, count: usize) {
    while assembler.complete.len() < count {
        if let ServerFrame::Piece(piece) = next(client).await.expect("closed before all came") {
            assembler.push(piece);
        }
    }
}

#[tokio::test]
async fn a_read_that_waits_holds_up_nothing_else() {
    let (state, go) = held(false);
    let mut client = Client::in_memory(&state).await;
    client.send(&hello()).await;
    client.send(&want_textures(2)).await;
    let mut assembler = Assembler::default();
    // Two base meshes and all textures but one.
    blobs(&mut client, &mut assembler, 2 + 15).await;
    assert!(assembler.complete.iter().all(|(id, _)| *id != HELD));
    go.send(()).unwrap();
    blobs(&mut client, &mut assembler, 2 + 16).await;
    assert_eq!(assembler.complete.last().map(|(id, _)| *id), Some(HELD));
}

#[tokio::test]
async fn a_session_ends_while_a_read_is_under_way() {
    let (state, go) = held(false);
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
async fn a_store_that_panics_is_told_as_a_blob_that_cannot_be_read() {
    let (state, go) = held(true);
    let mut client = Client::in_memory(&state).await;
    client.send(&hello()).await;
    client.send(&ClientMessage::Want(vec![Want::whole(HELD, 1)])).await;
    go.send(()).unwrap();
    loop {
        if let ServerFrame::Message(ServerMessage::Refused(refused)) =
            next(&mut client).await.expect("closed")
        {
            assert_eq!(refused.id, HELD);
            return;
        }
    }
}
