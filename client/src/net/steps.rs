//! Steps of opening a connection, each with a time limit.

#[cfg(feature = "websocket")]
use std::net::SocketAddr;
use std::time::Duration;

use lodestream_protocol::message::{Close, CloseCode};
#[cfg(feature = "websocket")]
use tokio::net::TcpStream;
#[cfg(feature = "websocket")]
use tokio::time::timeout;

/// Time limit of each step of opening a connection: TCP, TLS, the WebSocket request, QUIC's handshake.
pub(super) const STEP_TIMEOUT: Duration = Duration::from_secs(4);

/// The close of a failed attempt, without the address.
pub(super) fn lost(why: impl Into<String>) -> Close {
    Close::new(CloseCode::Lost, why)
}

pub(super) fn no_answer() -> Close {
    lost(format!("no answer within {} s", STEP_TIMEOUT.as_secs()))
}

#[cfg(feature = "websocket")]
pub(super) async fn open_tcp(server: SocketAddr) -> Result<TcpStream, Close> {
    let stream = match timeout(STEP_TIMEOUT, TcpStream::connect(server)).await {
        Ok(Ok(stream)) => stream,
        Ok(Err(why)) => return Err(lost(why.to_string())),
        Err(_) => return Err(no_answer()),
    };
    let _ = stream.set_nodelay(true);
    Ok(stream)
}
