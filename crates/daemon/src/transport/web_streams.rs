//! The unidirectional streams that a client opens on an HTTP/3 connection: those of its WebTransport session, among
//! HTTP/3's own.

use std::future::Future;
use std::pin::Pin;

use futures_util::StreamExt as _;
use futures_util::stream::FuturesUnordered;
use quinn::{Connection, ConnectionError, RecvStream, VarInt};
use web_transport_proto as h3;

/// Reads a stream's prefix.
type Opening = Pin<Box<dyn Future<Output = Option<(RecvStream, bool)>> + Send + Sync>>;

/// The streams of a session, in the order in which their prefixes are complete. HTTP/3's own are kept open without being
/// read: closing one would be an error of the connection. The connection's limits on streams and on unread bytes bound
/// them.
pub(crate) struct WebStreams {
    connection: Connection,
    session: VarInt,
    opening: FuturesUnordered<Opening>,
    others: Vec<RecvStream>,
}

impl std::fmt::Debug for WebStreams {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("WebStreams").field("session", &self.session).finish_non_exhaustive()
    }
}

impl WebStreams {
    /// The streams of the session that began on the stream with the number `session`.
    pub(crate) fn new(connection: Connection, session: VarInt) -> Self {
        Self { connection, session, opening: FuturesUnordered::new(), others: Vec::new() }
    }

    /// The session's next stream, after its prefix. Cancel safe.
    pub(crate) async fn accept(&mut self) -> Result<RecvStream, ConnectionError> {
        loop {
            tokio::select! {
                biased;
                Some(opened) = self.opening.next() => match opened {
                    Some((stream, true)) => return Ok(stream),
                    Some((stream, false)) => self.others.push(stream),
                    None => {}
                },
                stream = self.connection.accept_uni() => {
                    self.opening.push(Box::pin(open(stream?, self.session)));
                }
            }
        }
    }
}

/// Reads the type of a stream and, if it is WebTransport's, the session's number; tells whether it is the session's own.
/// `None` if the stream ends early.
async fn open(mut stream: RecvStream, session: VarInt) -> Option<(RecvStream, bool)> {
    let kind = h3::StreamUni(h3::VarInt::read(&mut stream).await.ok()?);
    if kind != h3::StreamUni::WEBTRANSPORT {
        return Some((stream, false));
    }
    let number = h3::VarInt::read(&mut stream).await.ok()?;
    Some((stream, number.into_inner() == session.into_inner()))
}
