//! Both sessions in virtual time, and the server against peers that misbehave.

mod bad_peers;
mod push;
mod rate;
mod reads;
mod requests;
mod sharing;
mod streaming;

use std::sync::Arc;

use super::{ServerConfig, ServerSession, Transmit};
use crate::message::{Close, Hello, ServerMessage};
use crate::testing::MemoryScene;
use crate::time::Time;
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::SceneHeader;

const MBIT: u64 = 1_000_000;

fn session(scene: &Arc<MemoryScene>, config: ServerConfig) -> ServerSession {
    ServerSession::new(Arc::new(config), Arc::clone(scene) as _, 1, Time::ZERO)
}

fn hello(scene: &SceneHeader) -> Hello {
    let view = Some(scene.camera.view([1280, 720], 1.0));
    Hello { view, max_blob_bytes: 1 << 20, ..Hello::new("") }
}

/// Everything that an open-ended poll gives at one moment.
fn drain(session: &mut ServerSession, now: Time) -> Vec<Transmit> {
    std::iter::from_fn(|| session.poll_transmit(now)).collect()
}

fn begun(transmits: &[Transmit]) -> Vec<BlobId> {
    transmits
        .iter()
        .filter_map(|t| match t {
            Transmit::Piece { piece, .. } if piece.offset == 0 => Some(piece.id),
            _ => None,
        })
        .collect()
}

fn last_close(transmits: &[Transmit]) -> Option<&Close> {
    match transmits.last() {
        Some(Transmit::Message { message: ServerMessage::Close(close), .. }) => Some(close),
        _ => None,
    }
}
