//! The sending half of a QUIC session: the control stream, begun as early data where that is possible.

use bytes::{Buf, Bytes};
use lodestream_protocol::message::Close;
use lodestream_protocol::stream::CONTROL_STREAM;
use quinn::{Connection, ConnectionError, SendStream, VarInt, WriteError};
use tokio::time::timeout_at;

use super::drive::Deliver;
use super::quic_open::Early;

/// Bytes of messages that may wait to be sent, or to be known to be accepted.
pub(super) const SEND_QUEUE_BYTES: usize = 64 * 1024;

/// The control stream.
#[derive(Debug)]
pub(super) struct QuicSender {
    connection: Connection,
    stream: SendStream,
    queue: Bytes,
    begun: bool,
    /// There until the server has answered.
    early: Option<Early>,
    /// All that was said before that. The server has then heard either all of it or nothing.
    said_early: Vec<u8>,
    /// The stream vanished with the early data; there must be another.
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
        let (queue, said_early) = (Bytes::new(), Vec::new());
        Ok(Self { connection, stream, queue, begun: false, early, said_early, rejected: false })
    }
}

impl Deliver for QuicSender {
    fn has_room(&self) -> bool {
        self.queue.len().max(self.said_early.len()) < SEND_QUEUE_BYTES
    }

    fn put(&mut self, frame: Vec<u8>) {
        let mut queue = Vec::with_capacity(1 + self.queue.len() + frame.len());
        queue.extend_from_slice(&self.queue);
        if !std::mem::replace(&mut self.begun, true) {
            queue.push(CONTROL_STREAM);
        }
        queue.extend_from_slice(&frame);
        if self.early.is_some() {
            self.said_early.extend_from_slice(&queue[self.queue.len()..]);
        }
        self.queue = queue.into();
    }

    fn is_idle(&self) -> bool {
        self.queue.is_empty() && self.early.is_none()
    }

    async fn flush(&mut self) -> Result<(), String> {
        loop {
            if self.rejected {
                match open_stream(&self.connection).await {
                    Ok(stream) => self.stream = stream,
                    // The receiving half tells why the connection is lost.
                    Err(_) => std::future::pending().await,
                }
                self.rejected = false;
            }
            while !self.queue.is_empty() {
                match self.stream.write(&self.queue).await {
                    Ok(count) => self.queue.advance(count),
                    Err(WriteError::ZeroRttRejected) if self.early.is_some() => break,
                    Err(why) => return Err(why.to_string()),
                }
            }
            let Some(early) = &mut self.early else { return Ok(()) };
            let accepted = timeout_at(early.until, &mut early.accepted).await;
            let accepted = accepted.map_err(|_| "the server does not answer".to_owned())?;
            self.early = None;
            let said = std::mem::take(&mut self.said_early);
            if !accepted {
                tracing::debug!(bytes = said.len(), "early data refused, said again");
                self.queue = said.into();
                self.rejected = true;
            }
        }
    }

    async fn finish(self, close: &Close) {
        self.connection.close(VarInt::from(close.code.number()), close.reason.as_bytes());
    }
}
