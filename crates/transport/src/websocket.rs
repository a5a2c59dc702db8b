//! The halves of a WebSocket: one binary message carries one frame.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::io;
use std::marker::PhantomData;
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use bytes::Bytes;
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{Sink, SinkExt, StreamExt};
use lodestream_protocol::frame::{Frame, FrameError, encode_client, encode_piece};
use lodestream_protocol::message::{ClientMessage, Close, CloseCode};
use lodestream_protocol::server::Transmit;
use lodestream_scene::limits::MAX_FRAME_BYTES;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::error::{CapacityError, ProtocolError};
use tokio_tungstenite::tungstenite::protocol::{CloseFrame, WebSocketConfig};
use tokio_tungstenite::tungstenite::{Error, Message};

use crate::halves::{Incoming, Received, Receiver, SendError, Sender};

/// Offset of close codes: WebSocket reserves 4000 and up for applications (RFC 6455 §7.4.2).
const CLOSE_CODE_BASE: u16 = 4000;
/// WebSocket's own code for a normal closure.
const NORMAL_CLOSURE: u16 = 1000;
/// Longest reason in a close frame (RFC 6455 §5.5): 125 bytes with the code.
const MAX_REASON_BYTES: usize = 123;

/// Settings of a WebSocket with a read buffer of this many bytes.
#[must_use]
pub fn config(read_buffer_bytes: usize) -> WebSocketConfig {
    WebSocketConfig::default()
        .read_buffer_size(read_buffer_bytes)
        // Frames are written at once, so the buffer holds one frame and pongs.
        .write_buffer_size(0)
        .max_write_buffer_size(2 * MAX_FRAME_BYTES)
        .max_message_size(Some(MAX_FRAME_BYTES))
        .max_frame_size(Some(MAX_FRAME_BYTES))
}

/// Splits a WebSocket into its halves. The sending half accepts `capacity` frames before they are sent.
pub fn split<S, F, T>(
    socket: WebSocketStream<S>,
    capacity: usize,
) -> (WebSocketReceiver<S, F>, WebSocketSender<S, T>)
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    let (sink, stream) = socket.split();
    let sender = WebSocketSender {
        sink,
        queue: VecDeque::new(),
        capacity,
        unflushed: false,
        queued_bytes: 0,
        items: PhantomData,
    };
    (WebSocketReceiver { stream, broken: false, frames: PhantomData }, sender)
}

/// The stream below two halves of one WebSocket.
pub fn reunite<S, F, T>(
    receiver: WebSocketReceiver<S, F>,
    sender: WebSocketSender<S, T>,
) -> Option<WebSocketStream<S>>
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    receiver.stream.reunite(sender.sink).ok()
}

/// Receiving half.
#[derive(Debug)]
pub struct WebSocketReceiver<S, F> {
    stream: SplitStream<WebSocketStream<S>>,
    broken: bool,
    frames: PhantomData<fn() -> F>,
}

impl<S: AsyncRead + AsyncWrite + Unpin, F> WebSocketReceiver<S, F> {
    /// Whether the peer violated WebSocket's framing: the stream has no further messages.
    #[must_use]
    pub const fn is_broken(&self) -> bool {
        self.broken
    }

    /// Reads and discards messages until the peer has closed the connection.
    pub async fn discard(&mut self) {
        while let Some(Ok(_)) = self.stream.next().await {}
    }
}

impl<S, F> Receiver for WebSocketReceiver<S, F>
where
    S: AsyncRead + AsyncWrite + Unpin + Send,
    F: Incoming,
{
    type Frame = F;

    async fn receive(&mut self) -> Received<F> {
        let message = match self.stream.next().await {
            None | Some(Err(Error::ConnectionClosed | Error::AlreadyClosed)) => {
                return Received::Closed(close_of(None, F::PEER));
            }
            Some(Err(why)) => {
                self.broken = true;
                return failure(why);
            }
            Some(Ok(message)) => message,
        };
        match message {
            Message::Binary(bytes) => Frame::parse(bytes).into(),
            Message::Text(_) => {
                Received::Violation(Close::new(CloseCode::Protocol, "text messages are not supported"))
            }
            Message::Close(frame) => Received::Closed(close_of(frame, F::PEER)),
            Message::Ping(_) | Message::Pong(_) | Message::Frame(_) => Received::Skipped,
        }
    }
}

fn failure<F>(error: Error) -> Received<F> {
    match error {
        Error::Capacity(CapacityError::MessageTooLong { size, max_size }) => {
            Received::Malformed(FrameError::TooLong { bytes: size as u64, limit: max_size })
        }
        // From the observer of the stream's reads.
        Error::Io(why) if why.kind() == io::ErrorKind::QuotaExceeded => {
            Received::Violation(Close::new(CloseCode::Limit, why.to_string()))
        }
        why @ (Error::Io(_) | Error::Protocol(ProtocolError::ResetWithoutClosingHandshake)) => {
            Received::Lost(why.to_string())
        }
        why => Received::Violation(Close::new(CloseCode::Protocol, why.to_string())),
    }
}

/// The reason in a peer's close frame.
fn close_of(frame: Option<CloseFrame>, peer: &str) -> Close {
    let closed = format!("the {peer} closed the connection");
    let Some(frame) = frame else { return Close::new(CloseCode::Lost, closed) };
    let (number, reason) = (u16::from(frame.code), frame.reason.as_str());
    let code = match number.checked_sub(CLOSE_CODE_BASE) {
        Some(number) => CloseCode::from_number(number.into()),
        None => (number == NORMAL_CLOSURE).then_some(CloseCode::Normal),
    };
    match code {
        Some(code) => Close::new(code, reason),
        None => Close::new(CloseCode::Lost, format!("{closed}: {number} {reason}")),
    }
}

/// The close frame of a reason, which is cut to WebSocket's limit.
fn close_frame(close: &Close) -> CloseFrame {
    let mut end = close.reason.len().min(MAX_REASON_BYTES);
    while !close.reason.is_char_boundary(end) {
        end -= 1;
    }
    let code = match close.code {
        CloseCode::Normal => NORMAL_CLOSURE,
        code => CLOSE_CODE_BASE + code.number(),
    };
    CloseFrame { code: code.into(), reason: close.reason[..end].into() }
}

/// An item that may be sent on a WebSocket.
pub trait Outgoing: Send {
    /// The frame; `None` if the item has none.
    ///
    /// # Errors
    /// The item is beyond a limit of the protocol.
    fn into_frame(self) -> Result<Option<Bytes>, FrameError>;
}

impl Outgoing for ClientMessage {
    fn into_frame(self) -> Result<Option<Bytes>, FrameError> {
        encode_client(&self).map(|frame| Some(frame.into()))
    }
}

impl Outgoing for Transmit {
    fn into_frame(self) -> Result<Option<Bytes>, FrameError> {
        match self {
            Self::Message { frame, .. } => Ok(Some(frame)),
            Self::Piece { piece, .. } => encode_piece(&piece).map(|frame| Some(frame.into())),
            Self::Abandon(_) => Ok(None),
        }
    }
}

/// Sending half.
#[derive(Debug)]
pub struct WebSocketSender<S, T> {
    sink: SplitSink<WebSocketStream<S>, Message>,
    queue: VecDeque<Bytes>,
    capacity: usize,
    /// Whether the WebSocket's buffer may hold a frame that is not yet written to the stream.
    unflushed: bool,
    queued_bytes: u64,
    items: PhantomData<fn(T)>,
}

impl<S: AsyncRead + AsyncWrite + Unpin, T> WebSocketSender<S, T> {
    /// Bytes of all frames so far.
    #[must_use]
    pub const fn queued_bytes(&self) -> u64 {
        self.queued_bytes
    }

    /// Sends the close frame; returns whether it was accepted. Nothing may be sent after it.
    pub async fn send_close(&mut self, close: &Close) -> bool {
        self.sink.send(Message::Close(Some(close_frame(close)))).await.is_ok()
    }

    fn poll(&mut self, context: &mut Context<'_>) -> Poll<Result<(), Error>> {
        let mut sink = Pin::new(&mut self.sink);
        while !self.queue.is_empty() {
            ready!(sink.as_mut().poll_ready(context))?;
            if let Some(frame) = self.queue.pop_front() {
                self.unflushed = true;
                sink.as_mut().start_send(Message::Binary(frame))?;
            }
        }
        if self.unflushed {
            ready!(sink.poll_flush(context))?;
            self.unflushed = false;
        }
        Poll::Ready(Ok(()))
    }
}

impl<S, T> Sender for WebSocketSender<S, T>
where
    S: AsyncRead + AsyncWrite + Unpin + Send,
    T: Outgoing,
{
    type Item = T;

    fn has_room(&self) -> bool {
        self.queue.len() + usize::from(self.unflushed) < self.capacity
    }

    fn push(&mut self, item: T) -> Result<usize, FrameError> {
        let Some(frame) = item.into_frame()? else { return Ok(0) };
        let length = frame.len();
        self.queued_bytes += length as u64;
        self.queue.push_back(frame);
        Ok(length)
    }

    fn is_idle(&self) -> bool {
        self.queue.is_empty() && !self.unflushed
    }

    async fn flush(&mut self) -> Result<(), SendError> {
        poll_fn(|context| self.poll(context)).await.map_err(|why| Box::new(why).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_close_code_round_trips_and_long_reasons_are_cut() {
        for code in CloseCode::ALL {
            let close = Close::new(code, "why");
            assert_eq!(close_of(Some(close_frame(&close)), "server"), close);
        }
        let long = close_frame(&Close::new(CloseCode::Busy, "é".repeat(100)));
        assert_eq!((u16::from(long.code), long.reason.as_str()), (4007, &*"é".repeat(61)));
    }

    #[test]
    fn a_close_without_a_code_of_ours_counts_as_lost() {
        let lost = |reason: &str| Close::new(CloseCode::Lost, reason);
        assert_eq!(close_of(None, "client"), lost("the client closed the connection"));
        let away = CloseFrame { code: 1001.into(), reason: "reload".into() };
        assert_eq!(close_of(Some(away), "client"), lost("the client closed the connection: 1001 reload"));
        let unknown = CloseFrame { code: 4999.into(), reason: "".into() };
        assert_eq!(close_of(Some(unknown), "server"), lost("the server closed the connection: 4999 "));
    }
}
