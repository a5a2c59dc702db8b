//! How many bytes a client may send. Messages are counted by themselves; but what is no message (fragments of none,
//! frames of WebSocket's own) costs a server work as well, and that is bounded by bytes.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::Instant;

/// Bytes that a client may send at once, and per second after that. Clients with thousands of wishes under way, who give
/// them new priorities ten times a second, send as much.
const BURST_BYTES: u64 = 512 << 10;
const BYTES_PER_S: u64 = 256 << 10;

/// What is said of who sends more.
pub(crate) const TOO_MUCH: &str = "more bytes from the client than 256 KiB a second";

/// A client's allowance of bytes, a token bucket on tokio's clock.
#[derive(Debug)]
pub(crate) struct ByteRateLimiter {
    bytes: u64,
    refilled: Instant,
}

impl ByteRateLimiter {
    /// A full bucket.
    pub(crate) fn new() -> Self {
        Self { bytes: BURST_BYTES, refilled: Instant::now() }
    }

    /// Takes so many bytes; `false` where that is too much.
    pub(crate) fn take(&mut self, count: usize) -> bool {
        let now = Instant::now();
        let ms = u64::try_from(now.duration_since(self.refilled).as_millis()).unwrap_or(u64::MAX);
        if ms > 0 {
            self.refilled = now;
            self.bytes = self.bytes.saturating_add(ms.saturating_mul(BYTES_PER_S) / 1000).min(BURST_BYTES);
        }
        let left = self.bytes.checked_sub(count as u64);
        self.bytes = left.unwrap_or(0);
        left.is_some()
    }
}

/// A stream that fails once more was read from it than the allowance. What was read is handed over all the same, so
/// that what lies above it, TLS perhaps, stays in step.
#[derive(Debug)]
pub(crate) struct Metered<S> {
    stream: S,
    intake: ByteRateLimiter,
    exceeded: bool,
    lifted: Lift,
}

/// Lifts the limit of a [`Metered`]: for who reads on only to throw away what comes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lift(Arc<AtomicBool>);

impl Lift {
    pub(crate) fn lift(&self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl<S> Metered<S> {
    pub(crate) fn new(stream: S) -> (Self, Lift) {
        let lifted = Lift::default();
        (Self { stream, intake: ByteRateLimiter::new(), exceeded: false, lifted: lifted.clone() }, lifted)
    }
}

/// Whether a failure is that of a [`Metered`].
pub(crate) fn is_too_much(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::QuotaExceeded
}

impl<S: AsyncRead + Unpin> AsyncRead for Metered<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if self.exceeded && !self.lifted.0.load(Ordering::Relaxed) {
            return Poll::Ready(Err(io::Error::new(io::ErrorKind::QuotaExceeded, TOO_MUCH)));
        }
        let before = buffer.filled().len();
        let polled = Pin::new(&mut self.stream).poll_read(context, buffer);
        let within = self.intake.take(buffer.filled().len() - before);
        self.exceeded |= !within;
        polled
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Metered<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use tokio::io::AsyncReadExt as _;

    use super::*;

    #[tokio::test(start_paused = true)]
    async fn bytes_are_allowed_at_their_rate() {
        let mut intake = ByteRateLimiter::new();
        let burst = (0..).take_while(|_| intake.take(1024)).count();
        assert_eq!(burst, 512);
        tokio::time::advance(Duration::from_secs(1)).await;
        assert_eq!((0..).take_while(|_| intake.take(1024)).count(), 256);
    }

    #[tokio::test(start_paused = true)]
    async fn what_is_read_before_the_limit_strikes_is_not_lost() {
        let sent: Vec<u8> = (0..=255).cycle().take(700 << 10).collect();
        let (mut metered, lift) = Metered::new(&sent[..]);
        let (mut got, mut piece) = (Vec::new(), [0; 4096]);
        let why = loop {
            match metered.read(&mut piece).await {
                Ok(count) => got.extend_from_slice(&piece[..count]),
                Err(why) => break why,
            }
        };
        assert!(is_too_much(&why) && (1..=4096).contains(&(got.len() as u64 - BURST_BYTES)), "{}", got.len());
        lift.lift();
        metered.read_to_end(&mut got).await.unwrap();
        assert!(got == sent);
    }
}
