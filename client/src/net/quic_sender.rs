//! The sending half of a QUIC session: the control stream, as early data (0-RTT) where possible.

use bytes::Bytes;
use futures_util::FutureExt;
use lodestream_protocol::frame::{FrameError, encode_client};
use lodestream_protocol::message::ClientMessage;
use lodestream_protocol::stream::CONTROL_STREAM;
use lodestream_transport::quic::{open_stream, write};
use lodestream_transport::{SendError, Sender};
use quinn::{Connection, ConnectionError, SendStream, StoppedError, WriteError};
use tokio::time::timeout_at;

use super::quic_open::Early;

/// Most bytes of messages that are queued, or sent as early data and not yet accepted.
pub(super) const SEND_QUEUE_BYTES: usize = 64 * 1024;

/// The control stream.
#[derive(Debug)]
pub(super) struct QuicSender {
    connection: Connection,
    stream: SendStream,
    queue: Bytes,
    /// Whether the stream's type byte has been queued.
    begun: bool,
    /// `Some` until the server has answered.
    early: Option<Early>,
    /// Bytes sent before the server's answer. The server accepts either all of them or none.
    sent_early: Vec<u8>,
    /// The server rejected early data, and the stream with it: another must be opened.
    rejected: bool,
}

impl QuicSender {
    pub(super) async fn open(connection: Connection, early: Option<Early>) -> Result<Self, ConnectionError> {
        let stream = open_stream(&connection, i32::MAX).await?;
        let (queue, sent_early) = (Bytes::new(), Vec::new());
        Ok(Self { connection, stream, queue, begun: false, early, sent_early, rejected: false })
    }
}

impl Sender for QuicSender {
    type Item = ClientMessage;

    fn has_room(&self) -> bool {
        self.queue.len().max(self.sent_early.len()) < SEND_QUEUE_BYTES
    }

    fn push(&mut self, message: ClientMessage) -> Result<usize, FrameError> {
        let frame = encode_client(&message)?;
        let mut queue = Vec::with_capacity(1 + self.queue.len() + frame.len());
        queue.extend_from_slice(&self.queue);
        if !std::mem::replace(&mut self.begun, true) {
            queue.push(CONTROL_STREAM);
        }
        queue.extend_from_slice(&frame);
        if self.early.is_some() {
            self.sent_early.extend_from_slice(&queue[self.queue.len()..]);
        }
        self.queue = queue.into();
        Ok(frame.len())
    }

    fn is_idle(&self) -> bool {
        self.queue.is_empty() && self.early.is_none()
    }

    async fn flush(&mut self) -> Result<(), SendError> {
        loop {
            if self.rejected {
                match open_stream(&self.connection, i32::MAX).await {
                    Ok(stream) => self.stream = stream,
                    // The receiving half reports why the connection is lost.
                    Err(_) => std::future::pending().await,
                }
                self.rejected = false;
            }
            match write(&mut self.stream, &mut self.queue).await {
                // The answer is awaited below.
                Err(WriteError::ZeroRttRejected) if self.early.is_some() => {}
                written => written?,
            }
            let Some(early) = &mut self.early else { return Ok(()) };
            let accepted = timeout_at(early.until, &mut early.accepted).await;
            let accepted = accepted.map_err(|_| SendError::NoAnswer)?;
            self.early = None;
            let sent = std::mem::take(&mut self.sent_early);
            if !accepted && is_rejected(&self.stream) {
                tracing::debug!(bytes = sent.len(), "the server rejected early data; sending it again");
                self.queue = sent.into();
                self.rejected = true;
            }
        }
    }
}

/// Whether the stream was opened before the server rejected early data. A stream opened after the answer is valid even
/// though early data was rejected; dropping it would end the control stream.
fn is_rejected(stream: &SendStream) -> bool {
    matches!(stream.stopped().now_or_never(), Some(Err(StoppedError::ZeroRttRejected)))
}
