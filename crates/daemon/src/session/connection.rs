//! The receiving and the sending half of a connection, as the session's loop uses them.

use std::future::Future;
use std::net::SocketAddr;

use lodestream_protocol::frame::FrameError;
use lodestream_protocol::message::ClientMessage;
use lodestream_protocol::server::Transmit;

/// An event from the client.
#[derive(Debug)]
pub(crate) enum Received {
    /// A message.
    Message(ClientMessage),
    /// A frame without effect; it counts as a message because it costs work.
    Ignored,
    /// The client exceeded the byte rate limit.
    ByteRateExceeded,
    /// Bytes that do not form a message.
    Malformed(FrameError),
    /// A violation of the transport's own rules.
    Violation(String),
    /// The client closed the connection normally.
    Ended,
    /// The transport failed.
    Lost(String),
}

/// Receiving half of a connection.
pub(crate) trait Receive: Send {
    /// The next event. Cancel safe. Not called again after `ByteRateExceeded`, `Malformed`, `Violation`, `Ended` or
    /// `Lost`.
    fn receive(&mut self) -> impl Future<Output = Received> + Send;

    /// The client's current address, if it can change.
    fn peer(&self) -> Option<SocketAddr> {
        None
    }
}

/// Sending half of a connection.
pub(crate) trait Deliver: Send {
    /// Accepts the next transmit and returns its length in bytes. Called only while idle.
    fn start(&mut self, transmit: Transmit) -> Result<usize, FrameError>;
    /// Whether the transport has accepted everything.
    fn is_idle(&self) -> bool;
    /// Resolves when the transport has accepted everything. Cancel safe.
    fn flush(&mut self) -> impl Future<Output = Result<(), String>> + Send;
}
