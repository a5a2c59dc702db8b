//! Opens a QUIC connection; with a session ticket (0-RTT) without waiting for the server's answer.

use std::time::Duration;

use quinn::{Connecting, Connection, ConnectionError, ZeroRttAccepted};
use tokio::time::{Instant, timeout_at};

/// An open QUIC connection, ready for a session.
///
/// With a ticket of an earlier connection it is usable before the server has answered: the session's `Hello` is early
/// data (0-RTT) in the first packet. An attacker can record and replay that packet, so early data must have no effect
/// but answers; servers reject the repetitions that they recognise. A server that rejects early data, for example after
/// a restart, completes the whole handshake instead, and the client resends the rejected data.
#[derive(Debug)]
pub struct QuicConnection {
    pub(super) connection: Connection,
    pub(super) early: Option<Early>,
}

/// Early data whose acceptance is not known yet.
pub(super) struct Early {
    /// Resolves with the server's answer.
    pub(super) accepted: ZeroRttAccepted,
    /// Deadline of the answer.
    pub(super) until: Instant,
}

impl std::fmt::Debug for Early {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Early").field("until", &self.until).finish_non_exhaustive()
    }
}

/// Why a connection could not be opened.
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
    /// Gives the connection once the handshake is complete, or at once if it is resumed. In both cases the handshake
    /// must be complete within `limit`; a resumed session otherwise ends as lost.
    ///
    /// # Errors
    /// The handshake fails or takes longer.
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

    /// Whether messages are sent as early data.
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
