//! TCP listeners: a long queue, and a task for each connection.

use std::future::Future;
use std::net::SocketAddr;
use std::time::Duration;

use anyhow::Context;
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::task::JoinSet;
use tokio::time::sleep;

use crate::session::state::{Phase, ServerState};

/// Connections that the system keeps until they are taken; it may be set to keep fewer (`net.core.somaxconn`). At
/// thousands a second a few hundred wait in the time that one turn of a busy thread takes.
const BACKLOG: u32 = 4096;
/// Pause after a connection could not be taken.
const AFTER_FAILURE: Duration = Duration::from_millis(100);

/// Listens on a TCP address.
///
/// # Errors
/// Fails where the address cannot be had.
pub(crate) fn listen_tcp(address: SocketAddr) -> anyhow::Result<TcpListener> {
    let about = || format!("cannot listen on TCP {address}");
    let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() };
    let socket = socket.with_context(about)?;
    // A server that starts again finds connections of its predecessor that are not quite over.
    #[cfg(unix)]
    socket.set_reuseaddr(true).with_context(about)?;
    if address.is_ipv6() && address.ip().is_unspecified() {
        // All addresses are those of IPv4 too, whatever the system's habit.
        let _ = socket2::SockRef::from(&socket).set_only_v6(false);
    }
    socket.bind(address).with_context(about)?;
    socket.listen(BACKLOG).with_context(about)
}

/// Takes connections until the daemon stops; how many there are is for `serve` to bound. All end with this.
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
                    // Out of file descriptors, or a client that is gone already.
                    tracing::warn!("cannot take a connection: {why}");
                    sleep(AFTER_FAILURE).await;
                }
            }
        }
    }
}
