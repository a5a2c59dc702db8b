//! The sending half of a QUIC session: the control stream, as early data (0-RTT) where possible.

use bytes::{Buf, Bytes};
use lodestream_protocol::message::Close;
use lodestream_protocol::stream::CONTROL_STREAM;
use quinn::{Connection, ConnectionError, SendStream, VarInt, WriteError};
use tokio::time::timeout_at;

use super::drive::{SendError, TransportSender};
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

async fn open_stream(connection: &Connection) -> Result<SendStream, ConnectionError> {
    let stream = connection.open_uni().await?;
    // Fails only on closed streams.
    let _ = stream.set_priority(i32::MAX);
    Ok(stream)
}

impl QuicSender {
    pub(super) async fn open(connection: Connection, early: Option<Early>) -> Result<Self, ConnectionError> {
        let stream = open_stream(&connection).await?;
        let (queue, sent_early) = (Bytes::new(), Vec::new());
        Ok(Self { connection, stream, queue, begun: false, early, sent_early, rejected: false })
    }
}

impl TransportSender for QuicSender {
    fn has_room(&self) -> bool {
        self.queue.len().max(self.sent_early.len()) < SEND_QUEUE_BYTES
    }

    fn queue(&mut self, frame: Vec<u8>) {
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
    }

    fn is_idle(&self) -> bool {
        self.queue.is_empty() && self.early.is_none()
    }

    async fn flush(&mut self) -> Result<(), SendError> {
        loop {
            if self.rejected {
                match open_stream(&self.connection).await {
                    Ok(stream) => self.stream = stream,
                    // The receiving half reports why the connection is lost.
                    Err(_) => std::future::pending().await,
                }
                self.rejected = false;
            }
            while !self.queue.is_empty() {
                match self.stream.write(&self.queue).await {
                    Ok(count) => self.queue.advance(count),
                    Err(WriteError::ZeroRttRejected) if self.early.is_some() => break,
                    Err(why) => return Err(why.into()),
                }
            }
            let Some(early) = &mut self.early else { return Ok(()) };
            let accepted = timeout_at(early.until, &mut early.accepted).await;
            let accepted = accepted.map_err(|_| SendError::NoAnswer)?;
            self.early = None;
            let sent = std::mem::take(&mut self.sent_early);
            if !accepted {
                tracing::debug!(bytes = sent.len(), "the server rejected early data; sending it again");
                self.queue = sent.into();
                self.rejected = true;
            }
        }
    }

    async fn finish(self, close: &Close) {
        self.connection.close(VarInt::from(close.code.number()), close.reason.as_bytes());
    }
}
