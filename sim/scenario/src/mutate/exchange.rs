//! A server session and a client core that exchange messages in memory and virtual time, without a link.

use std::sync::Arc;
use std::time::Duration;

use lodestream_client::core::{ClientCore, Config, Progress, StartView};
use lodestream_protocol::Time;
use lodestream_protocol::frame::{FrameError, ServerFrame, encode_piece};
use lodestream_protocol::message::CloseCode;
use lodestream_protocol::server::{ServerConfig, ServerSession, Transmit};
use lodestream_protocol::source::SceneSource;

/// The client's picture size.
const VIEWPORT_PX: [u32; 2] = [640, 360];
/// Most consecutive updates of the core per step.
const UPDATES: u32 = 10_000;
/// Most steps and virtual time until the picture is settled; the client retries damaged blobs for 3.5 s.
const TURNS: u32 = 20_000;
const LIMIT: Duration = Duration::from_secs(60);

/// A client core at the scene's start view.
pub(super) fn core() -> ClientCore {
    let start = StartView::OfScene { viewport_px: VIEWPORT_PX, target_px: 1.0 };
    let mut config = Config::new(start);
    config.cache_bytes = 16 << 20;
    ClientCore::new(config)
}

/// Updates a core until it has nothing to do, as a renderer that takes all changes; false if it never ends.
pub(super) fn work(core: &mut ClientCore, now: Time) -> bool {
    for _ in 0..UPDATES {
        let progress = core.update(now, u64::MAX);
        drop(core.take_changes(now, usize::MAX));
        if progress == Progress::Idle {
            return true;
        }
    }
    false
}

/// How an exchange ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ended {
    /// The picture is settled.
    Settled,
    /// The picture is final, but some blobs are missing.
    Lacking,
    /// One side closed the session.
    Closed(CloseCode),
    /// The exchange did not end.
    Never,
}

/// Streams a scene from a session to a core; `look` sees each frame as WebSocket would carry it.
pub(super) fn stream(source: Arc<dyn SceneSource>, mut look: impl FnMut(&[u8])) -> Result<Ended, FrameError> {
    let mut now = Time::ZERO;
    let mut server = ServerSession::new(Arc::new(ServerConfig::websocket(None)), source, 1, now);
    let mut core = core();
    core.connect(now);
    for _ in 0..TURNS {
        let mut moved = false;
        while let Some(message) = core.poll_transmit(now) {
            moved = true;
            server.handle_message(now, message);
        }
        while let Some(transmit) = server.poll_transmit(now) {
            moved = true;
            match transmit {
                Transmit::Message { message, frame, page_priority: _ } => {
                    look(&frame);
                    core.handle_frame(now, ServerFrame::Message(message));
                }
                Transmit::Piece { piece, .. } => {
                    look(&encode_piece(&piece)?);
                    core.handle_piece(now, piece);
                }
                Transmit::Abandon(id) => core.handle_abandoned(now, id),
            }
        }
        if !work(&mut core, now) {
            return Ok(Ended::Never);
        }
        if let Some(close) = core.closed() {
            return Ok(Ended::Closed(close.code));
        }
        if core.is_settled() {
            return Ok(Ended::Settled);
        }
        if core.lacking_blobs().next().is_some() {
            return Ok(Ended::Lacking);
        }
        if moved {
            continue;
        }
        let Some(next) = [core.poll_timeout(), server.poll_timeout()].into_iter().flatten().min() else {
            return Ok(Ended::Never);
        };
        now = next.max(now + Duration::from_millis(1));
        if Duration::from(now) > LIMIT {
            return Ok(Ended::Never);
        }
        core.handle_timeout(now);
        server.handle_timeout(now);
    }
    Ok(Ended::Never)
}
