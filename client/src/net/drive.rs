//! The loop that drives a core over a transport; the same for QUIC and WebSocket.

use std::future::{Future, pending};

use futures_util::FutureExt;
use lodestream_protocol::frame::ServerFrame;
use lodestream_protocol::message::{ClientMessage, Close, CloseCode, ServerMessage};
use lodestream_protocol::time::Time;
use lodestream_transport::{Clock, Received, Receiver, Sender};
use tokio::time::timeout;

use crate::core::{ClientCore, Progress};

/// Most items received in a row before the host's next turn.
const MAX_RECEIVED_IN_A_ROW: usize = 64;
/// Time limit for sending the last messages, and for closing the transport.
pub(super) const CLOSE_TIMEOUT: std::time::Duration = std::time::Duration::from_millis(500);

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

/// Runs one session until it ends; gives the reason. The caller then closes the transport. `received_bytes` gives the
/// transport payload received so far, handshake included.
pub(super) async fn drive<H: Host>(
    host: &mut H,
    clock: Clock,
    receiver: &mut impl Receiver<Frame = ServerFrame>,
    sender: &mut impl Sender<Item = ClientMessage>,
    received_bytes: impl Fn() -> u64,
) -> Close {
    host.core().connect(clock.now());
    let close = loop {
        let now = clock.now();
        host.core().note_transport_bytes(received_bytes());
        host.core().handle_timeout(now);
        let progress = host.turn(now);
        if host.wants_to_leave() {
            host.core().leave(now);
        }
        let core = host.core();
        while sender.has_room()
            && let Some(message) = core.poll_transmit(now)
        {
            // Only a bug makes the core produce a message that it would itself refuse.
            if let Err(why) = sender.push(message) {
                tracing::error!("a message cannot be sent: {why}");
            }
        }
        if let Some(close) = core.closed() {
            break close.clone();
        }
        let deadline = core.poll_timeout();
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
            () = clock.sleep_until(deadline.unwrap_or(now)), if deadline.is_some() => {}
            () = host.wake() => {}
        }
    };
    if close.code != CloseCode::Lost {
        let _ = timeout(CLOSE_TIMEOUT, sender.flush()).await;
    }
    host.core().note_transport_bytes(received_bytes());
    close
}

fn handle(core: &mut ClientCore, now: Time, received: Received<ServerFrame>) {
    match received {
        Received::Frame(frame) => core.handle_frame(now, frame),
        Received::Pieces(pieces) => {
            for piece in pieces {
                core.handle_piece(now, piece);
            }
        }
        Received::Abandoned(id) => core.handle_abandoned(now, id),
        Received::Malformed(why) => core.handle_frame_error(now, &why),
        Received::Closed(close) if close.code == CloseCode::Lost => core.handle_lost(now, &close.reason),
        Received::Closed(close) => core.handle_frame(now, ServerFrame::Message(ServerMessage::Close(close))),
        Received::Violation(Close { reason, .. }) | Received::Lost(reason) => core.handle_lost(now, &reason),
        Received::Skipped => {}
    }
}
