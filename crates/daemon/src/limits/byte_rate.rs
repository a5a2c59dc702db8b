//! Limit on the bytes that a client may send.
//!
//! [`MessageRateLimiter`](crate::limits::message_rate::MessageRateLimiter) bounds messages. Bytes that form no message
//! (incomplete fragments, WebSocket's own frames) also cost work; this bounds them.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use lodestream_protocol::Time;
use lodestream_transport::{ObservedStream, ReadObserver};
use tokio::time::Instant;

use crate::limits::token_bucket::EventBucket;

/// Bytes per second that a client may send in the long run: as many as a client with thousands of open requests needs to
/// change their priorities ten times a second.
const BYTES_PER_S: u32 = 256 << 10;
/// Time whose bytes a client may send at once: 512 KiB.
const BURST: Duration = Duration::from_secs(2);

/// Reason given to a client that exceeds the limit.
pub(crate) const BYTE_RATE_EXCEEDED: &str = "more than 256 KiB per second from the client";

/// Token bucket over the bytes of one client, on tokio's clock.
#[derive(Debug)]
pub(crate) struct ByteRateLimiter {
    bucket: EventBucket,
    start: Instant,
}

impl ByteRateLimiter {
    /// A full bucket.
    pub(crate) fn new() -> Self {
        Self { bucket: EventBucket::new(BYTES_PER_S, BURST), start: Instant::now() }
    }

    /// Takes the tokens of `count` bytes; returns whether there were enough.
    pub(crate) fn take(&mut self, count: usize) -> bool {
        self.bucket.take(Time::from(self.start.elapsed()), count)
    }
}

/// A stream whose reads fail once the byte rate is exceeded. Bytes already read are still delivered, so that a layer
/// above, such as TLS, keeps a complete record.
pub(crate) type MeteredStream<S> = ObservedStream<S, Meter>;

/// Limits the bytes read from a stream; beyond the limit reads fail with `QuotaExceeded`.
#[derive(Debug)]
pub(crate) struct Meter {
    limiter: ByteRateLimiter,
    exceeded: bool,
    lifted: MeterControl,
}

/// Handle that lifts the limit of a [`MeteredStream`], for a reader that discards the rest.
#[derive(Clone, Debug, Default)]
pub(crate) struct MeterControl(Arc<AtomicBool>);

impl MeterControl {
    /// Lets reads succeed from now on.
    pub(crate) fn lift(&self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Limits a stream's reads; gives the handle that lifts the limit too.
pub(crate) fn metered<S>(stream: S) -> (MeteredStream<S>, MeterControl) {
    let lifted = MeterControl::default();
    let meter = Meter { limiter: ByteRateLimiter::new(), exceeded: false, lifted: lifted.clone() };
    (ObservedStream::new(stream, meter), lifted)
}

impl ReadObserver for Meter {
    fn before_read(&mut self) -> io::Result<()> {
        if self.exceeded && !self.lifted.0.load(Ordering::Relaxed) {
            return Err(io::Error::new(io::ErrorKind::QuotaExceeded, BYTE_RATE_EXCEEDED));
        }
        Ok(())
    }

    fn after_read(&mut self, count: usize) {
        let admitted = self.limiter.take(count);
        self.exceeded |= !admitted;
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::AsyncReadExt as _;

    use super::*;

    #[tokio::test(start_paused = true)]
    async fn bytes_are_admitted_at_their_rate() {
        let mut limiter = ByteRateLimiter::new();
        let burst = (0..).take_while(|_| limiter.take(1024)).count();
        assert_eq!(burst, 512);
        tokio::time::advance(Duration::from_secs(1)).await;
        assert_eq!((0..).take_while(|_| limiter.take(1024)).count(), 256);
    }

    #[tokio::test(start_paused = true)]
    async fn bytes_read_before_the_limit_are_not_lost() {
        let sent: Vec<u8> = (0..=255).cycle().take(700 << 10).collect();
        let (mut metered, lift) = metered(&sent[..]);
        let (mut got, mut piece) = (Vec::new(), [0; 4096]);
        let why = loop {
            match metered.read(&mut piece).await {
                Ok(count) => got.extend_from_slice(&piece[..count]),
                Err(why) => break why,
            }
        };
        assert!(
            why.kind() == io::ErrorKind::QuotaExceeded && (1..=4096).contains(&(got.len() - (512 << 10))),
            "{}",
            got.len()
        );
        lift.lift();
        metered.read_to_end(&mut got).await.unwrap();
        assert!(got == sent);
    }
}
