//! An open WebTransport session: the halves of its streams, and its end on the `CONNECT` stream.

use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use hyper::StatusCode;
use lodestream_protocol::message::{ClientMessage, Close, CloseCode};
use lodestream_transport::quic::READ_BYTES;
use lodestream_transport::{Received, Receiver};
use quinn::{Connection, ReadError, RecvStream, SendStream, VarInt};
use tokio::time::timeout;
use web_transport_proto as h3;

use crate::session::state::ServerState;
use crate::transport::quic_stream::{ClientStreams, QuicReceiver, QuicSender, connection_end, finish_stream};
use crate::transport::web_streams::WebStreams;

/// Time limit for the client's acknowledgement of the end.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);
/// Most bytes that a client may send on the `CONNECT` stream after the request.
const MAX_CAPSULE_BYTES: usize = 64 * 1024;
/// Longest reason in the message that closes a session, in bytes.
const MAX_REASON_BYTES: usize = 1024;
/// `H3_NO_ERROR` (RFC 9114, section 8.1).
const NO_ERROR: VarInt = VarInt::from_u32(0x100);

/// A session's `CONNECT` stream, and HTTP/3's control stream. They stay open as long as the session.
#[derive(Debug)]
pub(crate) struct WebSession {
    pub(crate) connection: Connection,
    pub(crate) answer: SendStream,
    pub(crate) request: RecvStream,
    pub(crate) _control: SendStream,
}

impl WebSession {
    /// Accepts the request; `None` if the connection is lost.
    pub(crate) async fn answered(mut self) -> Option<Self> {
        h3::ConnectResponse::OK.write(&mut self.answer).await.ok()?;
        Some(self)
    }

    /// Refuses the request with a status, and closes the connection.
    pub(crate) async fn refuse(mut self, status: StatusCode, why: &str) {
        let _ = h3::ConnectResponse::new(status).write(&mut self.answer).await;
        self.end(why).await;
    }

    /// The session's two halves, and what ends it.
    pub(crate) fn halves(
        self,
        state: Arc<ServerState>,
        rate_bits_per_s: Option<u64>,
    ) -> (WebReceiver, QuicSender, WebEnd) {
        let Self { connection, answer, request, _control } = self;
        let session = VarInt::from(request.id());
        let mut prefix = Vec::new();
        h3::StreamUni::WEBTRANSPORT.encode(&mut prefix);
        // Always: the number of a stream is below the limit of this encoding.
        h3::VarInt::from_u64(session.into_inner()).unwrap_or(h3::VarInt::MAX).encode(&mut prefix);
        let abandoned = VarInt::from_u64(h3::error_to_http3(0)).unwrap_or(VarInt::MAX);
        let streams = ClientStreams::OfSession(WebStreams::new(connection.clone(), session));
        let control = QuicReceiver::new(streams, state);
        let receiver = WebReceiver { control, request, left: MAX_CAPSULE_BYTES };
        let sender =
            QuicSender::with_prefix(connection.clone(), rate_bits_per_s, Bytes::from(prefix), abandoned);
        (receiver, sender, WebEnd { connection, answer, _control })
    }

    async fn end(self, why: &str) {
        let Self { connection, answer, request: _request, _control } = self;
        WebEnd { connection, answer, _control }.end(why).await;
    }
}

/// What is left of a session to end it.
#[derive(Debug)]
pub(crate) struct WebEnd {
    connection: Connection,
    answer: SendStream,
    _control: SendStream,
}

impl WebEnd {
    /// Ends the session with a reason that the page's `closed` gives, and closes the connection.
    pub(crate) async fn close(mut self, close: &Close) {
        if close.code != CloseCode::Lost {
            let mut end = close.reason.len().min(MAX_REASON_BYTES);
            while !close.reason.is_char_boundary(end) {
                end -= 1;
            }
            let capsule = h3::Capsule::CloseWebTransportSession {
                code: u32::from(close.code.number()),
                reason: close.reason[..end].to_owned(),
            };
            let (mut body, mut frame) = (Vec::new(), Vec::new());
            capsule.encode(&mut body);
            h3::Frame::DATA.encode(&mut frame);
            h3::VarInt::from_u32(u32::try_from(body.len()).unwrap_or(u32::MAX)).encode(&mut frame);
            frame.extend_from_slice(&body);
            let _ = timeout(CLOSE_TIMEOUT, self.answer.write_all(&frame)).await;
        }
        self.end(&close.reason).await;
    }

    /// Ends the answer, waits until the client has it, and closes the connection.
    async fn end(mut self, why: &str) {
        finish_stream(&mut self.answer, &self.connection).await;
        self.connection.close(NO_ERROR, why.as_bytes());
    }
}

/// Receiving half: the client's control stream, and the `CONNECT` stream, whose end is the session's.
#[derive(Debug)]
pub(crate) struct WebReceiver {
    control: QuicReceiver,
    request: RecvStream,
    /// Bytes that are still accepted on the `CONNECT` stream.
    left: usize,
}

impl Receiver for WebReceiver {
    type Frame = ClientMessage;

    async fn receive(&mut self) -> Received<ClientMessage> {
        tokio::select! {
            biased;
            received = self.control.receive() => received,
            ended = ended(&mut self.request, &mut self.left) => ended,
        }
    }
}

/// Waits until the client ends the session: what it sends before on the `CONNECT` stream says only why. Cancel safe.
async fn ended(request: &mut RecvStream, left: &mut usize) -> Received<ClientMessage> {
    loop {
        match request.read_chunk(READ_BYTES, true).await {
            Ok(Some(chunk)) => match left.checked_sub(chunk.bytes.len()) {
                Some(rest) => *left = rest,
                None => {
                    let why = format!("more than {MAX_CAPSULE_BYTES} bytes on the CONNECT stream");
                    return Received::Violation(Close::new(CloseCode::Limit, why));
                }
            },
            Ok(None) => return Received::Closed(Close::new(CloseCode::Normal, "the client left")),
            Err(ReadError::ConnectionLost(why)) => return connection_end(&why),
            Err(why) => return Received::Lost(format!("the client's CONNECT stream failed: {why}")),
        }
    }
}
