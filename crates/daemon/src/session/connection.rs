//! The two halves of a transport, as a session's loop sees them.

use std::future::Future;
use std::net::SocketAddr;

use lodestream_protocol::frame::FrameError;
use lodestream_protocol::message::ClientMessage;
use lodestream_protocol::server::Transmit;

/// What came from the client.
#[derive(Debug)]
pub(crate) enum Received {
    /// A message.
    Message(ClientMessage),
    /// Something that is passed over, and counts as a message all the same: it was work.
    Ignored,
    /// More bytes than a client may send.
    ByteRateExceeded,
    /// Bytes that are no message.
    Malformed(FrameError),
    /// A breach of the transport's own rules.
    Violation(String),
    /// The client ended the session in good order.
    Ended,
    /// The transport failed.
    Lost(String),
}

/// Receiving half of a transport.
pub(crate) trait Receive: Send {
    /// The next thing that comes. Must be safe to drop before it resolves. Not called again after
    /// `ByteRateExceeded`, `Malformed`, `Violation`, `Ended` or `Lost`.
    fn receive(&mut self) -> impl Future<Output = Received> + Send;

    /// Where the client is now, if that may change.
    fn peer(&self) -> Option<SocketAddr> {
        None
    }
}

/// Sending half of a transport.
pub(crate) trait Deliver: Send {
    /// Takes the next thing to send and gives its length in bytes. Called only while idle.
    fn start(&mut self, transmit: Transmit) -> Result<usize, FrameError>;
    /// Whether the transport has taken everything.
    fn is_idle(&self) -> bool;
    /// Resolves when the transport has taken everything. Must be safe to drop before it resolves.
    fn flush(&mut self) -> impl Future<Output = Result<(), String>> + Send;
}
