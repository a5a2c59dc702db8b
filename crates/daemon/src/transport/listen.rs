//! TCP listeners with a long backlog, and a task per connection.

use std::future::Future;
use std::net::SocketAddr;
use std::time::Duration;

use anyhow::Context;
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::task::JoinSet;
use tokio::time::sleep;

use crate::session::state::{Phase, ServerState};

/// Backlog of pending connections; the system may limit it (`net.core.somaxconn`). At thousands per second, a few hundred
/// arrive during one turn of a busy thread.
const BACKLOG: u32 = 4096;
/// Pause after a failed `accept`.
const RETRY_DELAY: Duration = Duration::from_millis(100);

/// Listens on a TCP address.
///
/// # Errors
/// The address cannot be bound.
pub(crate) fn listen_tcp(address: SocketAddr) -> anyhow::Result<TcpListener> {
    let about = || format!("cannot listen on TCP {address}");
    let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() };
    let socket = socket.with_context(about)?;
    // After a restart, connections of the previous process may remain in TIME_WAIT.
    #[cfg(unix)]
    socket.set_reuseaddr(true).with_context(about)?;
    if address.is_ipv6() && address.ip().is_unspecified() {
        // Accept IPv4 too, whatever the system's default.
        let _ = socket2::SockRef::from(&socket).set_only_v6(false);
    }
    socket.bind(address).with_context(about)?;
    socket.listen(BACKLOG).with_context(about)
}

/// Accepts connections and runs `serve` for each until the daemon stops, then aborts them. `serve` bounds their number.
pub(crate) async fn accept_each<F>(
    listener: TcpListener,
    state: &ServerState,
    serve: impl Fn(TcpStream, SocketAddr) -> F,
) where
    F: Future<Output = ()> + Send + 'static,
{
    let mut connections = JoinSet::new();
    loop {
        tokio::select! {
            biased;
            () = state.wait_for_phase(Phase::Stopped) => break,
            Some(_) = connections.join_next() => {}
            accepted = listener.accept() => match accepted {
                Ok((stream, peer)) => {
                    connections.spawn(serve(stream, peer));
                }
                Err(why) => {
                    // Out of file descriptors, or a connection that was reset already.
                    tracing::warn!("cannot accept a connection: {why}");
                    sleep(RETRY_DELAY).await;
                }
            }
        }
    }
}
