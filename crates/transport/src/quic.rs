//! What the two ends of a QUIC connection have in common: close codes, and streams of control frames.

use bytes::{Buf, Bytes};
use lodestream_protocol::frame::FrameReader;
use lodestream_protocol::message::{Close, CloseCode};
use quinn::{Connection, ConnectionError, SendStream, VarInt, WriteError};

use crate::halves::{Incoming, Received};

/// Most bytes read from a stream at once.
pub const READ_BYTES: usize = 16 * 1024;

/// The reason for the end of a connection, from the peer (`server` or `client`) or the transport. The code is `Lost`
/// only if the transport failed.
#[must_use]
pub fn close_of(error: &ConnectionError, peer: &str) -> Close {
    match error {
        ConnectionError::ApplicationClosed(close) => {
            let code = CloseCode::from_number(close.error_code.into_inner()).unwrap_or(CloseCode::Protocol);
            let reason = String::from_utf8_lossy(&close.reason);
            let closed = || format!("the {peer} closed the connection");
            Close::new(code, if reason.is_empty() { closed() } else { reason.into_owned() })
        }
        ConnectionError::TimedOut => Close::new(CloseCode::Lost, format!("the {peer} does not answer")),
        other => Close::new(CloseCode::Lost, other.to_string()),
    }
}

/// Closes a connection with a reason.
pub fn close(connection: &Connection, close: &Close) {
    connection.close(VarInt::from(close.code.number()), close.reason.as_bytes());
}

/// Opens a stream with a priority.
///
/// # Errors
/// The connection is lost.
pub async fn open_stream(connection: &Connection, priority: i32) -> Result<SendStream, ConnectionError> {
    let stream = connection.open_uni().await?;
    // Fails only on closed streams.
    let _ = stream.set_priority(priority);
    Ok(stream)
}

/// Writes all bytes. Cancel safe: written bytes are removed.
///
/// # Errors
/// The stream cannot be written.
pub async fn write(stream: &mut SendStream, bytes: &mut Bytes) -> Result<(), WriteError> {
    while !bytes.is_empty() {
        // Copies, since a slice in quinn's buffers would keep the whole blob in memory.
        let count = stream.write(bytes).await?;
        bytes.advance(count);
    }
    Ok(())
}

/// The next complete frame of a stream of control frames, if there is one.
pub fn next_frame<F: Incoming>(frames: &mut FrameReader) -> Option<Received<F>> {
    frames.next_frame().transpose().map(Received::from)
}
