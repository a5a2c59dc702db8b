//! The loop that drives a core over a transport; the same for QUIC and WebSocket.

use std::future::{Future, pending};

use futures_util::FutureExt;
use lodestream_protocol::frame::{BlobPiece, FrameError, ServerFrame, encode_client};
use lodestream_protocol::message::{Close, CloseCode, ServerMessage};
use lodestream_protocol::time::Time;
use lodestream_scene::blob::BlobId;
use tokio::time::{Instant, sleep_until, timeout};

use crate::core::{ClientCore, Progress};

/// Most items received in a row before the host's next turn.
const MAX_RECEIVED_IN_A_ROW: usize = 64;
/// Time limit for sending the last messages and closing the transport.
const CLOSE_TIMEOUT: std::time::Duration = std::time::Duration::from_millis(500);

/// The clock of a client: tokio's, so that virtual time works, counted from a start.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    start: Instant,
}

impl Clock {
    /// A clock that starts now.
    #[must_use]
    pub fn start() -> Self {
        Self { start: Instant::now() }
    }

    /// A clock that started at `start`.
    #[cfg(feature = "runtime")]
    #[must_use]
    pub const fn since(start: Instant) -> Self {
        Self { start }
    }

    /// The time since the start.
    #[must_use]
    pub fn now(&self) -> Time {
        Time::from(self.start.elapsed())
    }

    fn instant(&self, time: Time) -> Instant {
        self.start + std::time::Duration::from(time)
    }
}

/// Owner of the core while `drive` runs it.
pub trait Host {
    /// The core.
    fn core(&mut self) -> &mut ClientCore;

    /// Called after every event: runs [`ClientCore::update`] and whatever the host does with the outcome.
    fn turn(&mut self, now: Time) -> Progress {
        self.core().update(now, u64::MAX)
    }

    /// Resolves when the host needs a turn without an event from the network. The driver may drop the future and call
    /// this again at any time.
    fn wake(&mut self) -> impl Future<Output = ()> {
        pending()
    }

    /// Whether the session should be ended.
    fn wants_to_leave(&self) -> bool {
        false
    }
}

impl Host for ClientCore {
    fn core(&mut self) -> &mut ClientCore {
        self
    }
}

/// An item received from the server.
#[cfg_attr(not(feature = "quic"), allow(dead_code, reason = "only its streams carry pieces"))]
#[derive(Debug)]
pub(super) enum Received {
    /// A control message, or a piece on WebSocket.
    Frame(ServerFrame),
    /// Pieces of one blob.
    Pieces(Vec<BlobPiece>),
    /// The stream of a blob was reset.
    Abandoned(BlobId),
    /// Bytes that are not a valid message.
    Malformed(FrameError),
    /// The server ended the connection with a reason.
    Closed(Close),
    /// The transport failed or ended.
    Lost(String),
    /// Nothing that the core needs to know.
    Nothing,
}

/// Frames could not be sent: the transport is lost.
#[derive(Debug, thiserror::Error)]
pub(super) enum SendError {
    /// The QUIC stream cannot be written.
    #[cfg(feature = "quic")]
    #[error(transparent)]
    Quic(#[from] quinn::WriteError),
    /// The server has not answered early data in time.
    #[cfg(feature = "quic")]
    #[error("the server does not answer")]
    NoAnswer,
    /// The WebSocket cannot be written.
    #[cfg(feature = "websocket")]
    #[error(transparent)]
    WebSocket(#[from] Box<tokio_tungstenite::tungstenite::Error>),
}

/// The receiving half of a transport.
pub(super) trait TransportReceiver {
    /// The next item from the server. Cancel-safe.
    fn receive(&mut self) -> impl Future<Output = Received>;

    /// Transport payload received so far, handshake included.
    fn received_bytes(&self) -> u64;
}

/// The sending half of a transport.
pub(super) trait TransportSender {
    /// Whether the queue has room for another frame.
    fn has_room(&self) -> bool;

    /// Queues a frame.
    fn queue(&mut self, frame: Vec<u8>);

    /// Whether nothing is left to send.
    fn is_idle(&self) -> bool;

    /// Sends the queued frames. Cancel-safe: what was sent has left the queue.
    ///
    /// # Errors
    /// The transport is lost.
    fn flush(&mut self) -> impl Future<Output = Result<(), SendError>>;

    /// Ends the connection.
    fn finish(self, close: &Close) -> impl Future<Output = ()>;
}

/// Runs one session until it ends; gives the reason.
pub(super) async fn drive<H: Host, R: TransportReceiver, S: TransportSender>(
    host: &mut H,
    clock: Clock,
    mut receiver: R,
    mut sender: S,
) -> Close {
    host.core().connect(clock.now());
    let close = loop {
        let now = clock.now();
        host.core().note_transport_bytes(receiver.received_bytes());
        host.core().handle_timeout(now);
        let progress = host.turn(now);
        if host.wants_to_leave() {
            host.core().leave(now);
        }
        let core = host.core();
        while sender.has_room()
            && let Some(message) = core.poll_transmit(now)
        {
            match encode_client(&message) {
                Ok(frame) => sender.queue(frame),
                // Only a bug makes the core produce a message that it would itself refuse.
                Err(why) => tracing::error!("a message cannot be sent: {why}"),
            }
        }
        if let Some(close) = core.closed() {
            break close.clone();
        }
        let deadline = core.poll_timeout().map(|time| clock.instant(time));
        let (again, sending) = (progress == Progress::More, !sender.is_idle());
        tokio::select! {
            biased;
            received = receiver.receive() => {
                handle(host.core(), clock.now(), received);
                for _ in 0..MAX_RECEIVED_IN_A_ROW {
                    let Some(received) = receiver.receive().now_or_never() else { break };
                    handle(host.core(), clock.now(), received);
                }
            }
            sent = sender.flush(), if sending => {
                if let Err(why) = sent {
                    host.core().handle_lost(clock.now(), &why.to_string());
                }
            }
            () = tokio::task::yield_now(), if again => {}
            () = sleep_until(deadline.unwrap_or_else(Instant::now)), if deadline.is_some() => {}
            () = host.wake() => {}
        }
    };
    if close.code != CloseCode::Lost {
        let _ = timeout(CLOSE_TIMEOUT, sender.flush()).await;
    }
    host.core().note_transport_bytes(receiver.received_bytes());
    let _ = timeout(CLOSE_TIMEOUT, sender.finish(&close)).await;
    close
}

fn handle(core: &mut ClientCore, now: Time, received: Received) {
    match received {
        Received::Frame(frame) => core.handle_frame(now, frame),
        Received::Pieces(pieces) => {
            for piece in pieces {
                core.handle_piece(now, piece);
            }
        }
        Received::Abandoned(id) => core.handle_abandoned(now, id),
        Received::Malformed(why) => core.handle_frame_error(now, &why),
        Received::Closed(close) => core.handle_frame(now, ServerFrame::Message(ServerMessage::Close(close))),
        Received::Lost(why) => core.handle_lost(now, &why),
        Received::Nothing => {}
    }
}
