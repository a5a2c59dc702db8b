//! Opening a QUIC connection, without waiting for the server's answer where it is known.

use std::time::Duration;

use quinn::{Connecting, Connection, ConnectionError, ZeroRttAccepted};
use tokio::time::{Instant, timeout_at};

/// A connection on which a session can begin.
///
/// With a ticket of an earlier connection it is there before the server has answered: what the session says first,
/// its `Hello`, is early data (0-RTT) and rides in the first packet. Whoever records that packet can send it again,
/// so early data must lead to nothing but answers; servers refuse what they recognise as a repetition.
/// A server that refuses early data, as after a restart, goes through the whole handshake instead; what was
/// said is then said again.
#[derive(Debug)]
pub struct QuicConnection {
    pub(super) connection: Connection,
    pub(super) early: Option<Early>,
}

/// A server that has not answered yet.
pub(super) struct Early {
    /// Becomes known with its answer.
    pub(super) accepted: ZeroRttAccepted,
    /// Until when it may.
    pub(super) until: Instant,
}

impl std::fmt::Debug for Early {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Early").field("until", &self.until).finish_non_exhaustive()
    }
}

/// A connection that did not come about.
#[derive(Debug, thiserror::Error)]
pub enum QuicOpenError {
    /// The handshake failed.
    #[error(transparent)]
    Handshake(#[from] ConnectionError),
    /// No answer in time.
    #[error("the server does not answer")]
    Timeout,
}

impl QuicConnection {
    /// Gives the connection once the handshake is complete, or at once where it can be resumed. The handshake has to
    /// be complete within `limit`, in the second case too: the session ends as lost otherwise.
    ///
    /// # Errors
    /// Fails where the handshake fails or takes longer.
    pub async fn open(connecting: Connecting, limit: Duration) -> Result<Self, QuicOpenError> {
        let until = Instant::now() + limit;
        match connecting.into_0rtt() {
            Ok((connection, accepted)) => Ok(Self { connection, early: Some(Early { accepted, until }) }),
            Err(connecting) => match timeout_at(until, connecting).await {
                Ok(connection) => Ok(connection?.into()),
                Err(_) => Err(QuicOpenError::Timeout),
            },
        }
    }

    /// Whether what is said now is early data.
    #[must_use]
    pub const fn is_early(&self) -> bool {
        self.early.is_some()
    }

    /// The connection itself.
    #[must_use]
    pub const fn connection(&self) -> &Connection {
        &self.connection
    }
}

impl From<Connection> for QuicConnection {
    fn from(connection: Connection) -> Self {
        Self { connection, early: None }
    }
}
