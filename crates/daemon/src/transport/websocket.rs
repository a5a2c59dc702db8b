//! A session over WebSocket: one binary message per frame.

use std::time::Duration;

use lodestream_protocol::message::{ClientMessage, Close, CloseCode};
use lodestream_protocol::server::Transmit;
use lodestream_transport::websocket::{WebSocketReceiver, WebSocketSender, config, reunite, split};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite};
use tokio::time::{Instant, timeout};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::protocol::Role;
use tracing::Instrument;

use crate::limits::byte_rate::MeterControl;
use crate::session::drive::drive;
use crate::session::guard::SessionGuard;

/// Read buffer of each connection, in bytes.
const READ_BUFFER_BYTES: usize = 4 * 1024;
/// Time limit of the closing handshake.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);
/// Most bytes that are read and discarded from a client that violated the protocol, so that `Close` reaches it.
const MAX_DISCARDED_BYTES: usize = 1 << 20;

/// Runs the session of `guard` over a stream with a byte rate limit.
pub(crate) async fn run_session<S>(stream: S, meter: MeterControl, mut guard: SessionGuard)
where
    S: AsyncRead + AsyncWrite + Unpin + Send,
{
    let span = tracing::info_span!("session", id = guard.id, transport = "ws", peer = %guard.peer);
    async {
        let started = Instant::now();
        let config = config(READ_BUFFER_BYTES);
        let socket = WebSocketStream::from_raw_socket(stream, Role::Server, Some(config)).await;
        let (mut receiver, mut sender) = split(socket, 1);
        // TCP's handshake has validated the address.
        let validation = std::future::ready(());
        let close = drive(&mut guard, validation, || None, &mut receiver, &mut sender).await;
        tracing::info!(
            scene = guard.scene_name(),
            bytes = sender.queued_bytes(),
            seconds = started.elapsed().as_secs_f32(),
            "session ended: {close}"
        );
        finish(sender, receiver, &meter, &close).await;
    }
    .instrument(span)
    .await;
}

/// Performs the closing handshake: our close frame, then the client's.
async fn finish<S>(
    mut sender: WebSocketSender<S, Transmit>,
    mut receiver: WebSocketReceiver<S, ClientMessage>,
    meter: &MeterControl,
    close: &Close,
) where
    S: AsyncRead + AsyncWrite + Unpin,
{
    if close.code == CloseCode::Lost {
        return;
    }
    let _ = timeout(CLOSE_TIMEOUT, async {
        if !sender.send_close(close).await {
            return;
        }
        // Frames of a client that exceeded a limit are not parsed.
        if !receiver.is_broken() && close.code != CloseCode::Limit {
            receiver.discard().await;
        } else if let Some(mut socket) = reunite(receiver, sender) {
            // The bytes that remain are discarded: closing a TCP socket with unread bytes resets it, and `Close` would be
            // lost.
            meter.lift();
            let stream = socket.get_mut();
            let mut discarded = [0; READ_BUFFER_BYTES];
            let mut left = MAX_DISCARDED_BYTES;
            while left > 0
                && let Ok(count @ 1..) = stream.read(&mut discarded).await
            {
                left = left.saturating_sub(count);
            }
        }
    })
    .await;
}
