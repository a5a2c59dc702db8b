//! A response's body in pieces, so that its progress shows: a file of a megabyte takes longer over a thin link than a
//! request may take, but a client that reads nothing must not hold its connection.

use std::convert::Infallible;
use std::future::Future;
use std::pin::{Pin, pin};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use bytes::Bytes;
use http_body_util::Full;
use hyper::body::{Body, Frame, SizeHint};
use tokio::time::{Instant, sleep_until};

/// Bytes of a piece: what hyper buffers before it waits for the socket.
const PIECE_BYTES: usize = 16 * 1024;

/// Time of a connection's last progress.
#[derive(Clone, Debug)]
pub(crate) struct Progress(Arc<Mutex<Instant>>);

impl Progress {
    /// Starts now.
    pub(crate) fn start() -> Self {
        Self(Arc::new(Mutex::new(Instant::now())))
    }

    fn note(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    fn last(&self) -> Instant {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs a connection until it makes no progress for `pause`, or has lasted `at_most`; then returns `None`.
    pub(crate) async fn limit<T>(
        &self,
        connection: impl Future<Output = T>,
        pause: Duration,
        at_most: Duration,
    ) -> Option<T> {
        let mut connection = pin!(connection);
        let end = Instant::now() + at_most;
        loop {
            let until = (self.last() + pause).min(end);
            tokio::select! {
                biased;
                ended = connection.as_mut() => return Some(ended),
                () = sleep_until(until) => {}
            }
            if until == (self.last() + pause).min(end) {
                return None;
            }
        }
    }
}

/// A body that notes each piece which the connection takes.
#[derive(Debug)]
pub(crate) struct PacedBody {
    whole: Full<Bytes>,
    rest: Bytes,
    progress: Progress,
}

impl PacedBody {
    /// A body whose pieces are noted in `progress`.
    pub(crate) fn new(whole: Full<Bytes>, progress: Progress) -> Self {
        Self { whole, rest: Bytes::new(), progress }
    }
}

impl Body for PacedBody {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        if self.rest.is_empty() {
            let Some(Ok(frame)) = ready!(Pin::new(&mut self.whole).poll_frame(context)) else {
                return Poll::Ready(None);
            };
            self.rest = frame.into_data().unwrap_or_default();
        }
        self.progress.note();
        let length = self.rest.len().min(PIECE_BYTES);
        Poll::Ready(Some(Ok(Frame::data(self.rest.split_to(length)))))
    }

    fn is_end_stream(&self) -> bool {
        self.rest.is_empty() && self.whole.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        let whole = self.whole.size_hint().exact().unwrap_or(0);
        SizeHint::with_exact(self.rest.len() as u64 + whole)
    }
}
