//! A TCP connection in virtual time, as two byte streams.
//!
//! [`crate::tcp`] states what is modelled. A write completes when its bytes enter the network; while the windows are
//! full, the writer waits, as for a full send buffer.

use std::future::Future;
use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::Sleep;

use crate::clock::VirtualClock;
use crate::link::{LinkCounters, LinkSettings};
use crate::tcp::{TcpDirection, TcpUnsupported};
use crate::trace::Trace;

/// One direction, with the tasks that wait for it.
#[derive(Debug)]
struct Direction {
    tcp: TcpDirection,
    reader: Option<Waker>,
    writer: Option<Waker>,
    reader_gone: bool,
    received_bytes: u64,
    trace: Trace,
}

type Shared = Arc<Mutex<Direction>>;

fn lock(shared: &Shared) -> MutexGuard<'_, Direction> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// One end of a simulated TCP connection. Dropping it ends both directions.
#[derive(Debug)]
pub struct StreamEnd {
    clock: VirtualClock,
    incoming: Shared,
    outgoing: Shared,
    read_timer: Option<Pin<Box<Sleep>>>,
    write_timer: Option<Pin<Box<Sleep>>>,
}

/// Counters of a connection that outlive its ends.
#[derive(Clone, Debug)]
pub struct StreamCounters {
    down: Shared,
    up: Shared,
}

impl StreamCounters {
    /// Payload that the client has read.
    #[must_use]
    pub fn client_received_bytes(&self) -> u64 {
        lock(&self.down).received_bytes
    }

    /// Fingerprint of the time and size of every write, in both directions.
    #[must_use]
    pub fn trace(&self) -> u64 {
        let mut both = Trace::default();
        both.add(lock(&self.down).trace.value());
        both.add(lock(&self.up).trace.value());
        both.value()
    }

    /// Counters of the links: server to client, client to server.
    #[must_use]
    pub fn links(&self) -> [LinkCounters; 2] {
        [lock(&self.down).tcp.counters(), lock(&self.up).tcp.counters()]
    }
}

/// A connection that is about to be opened.
#[derive(Debug)]
pub struct Opening {
    /// The client's end, to be used from `client_ready_ns`.
    pub client: StreamEnd,
    /// The server's end, to be used from `server_ready_ns`.
    pub server: StreamEnd,
    /// When the client has received the SYN-ACK.
    pub client_ready_ns: u64,
    /// When the server has received the client's ACK.
    pub server_ready_ns: u64,
    /// Counters of the connection.
    pub counters: StreamCounters,
}

/// Opens a connection with TCP's three-way handshake, starting now: `down` leads from the server to the client, `up`
/// back; `seed` determines jitter.
///
/// # Errors
/// Links over which TCP is not modelled.
pub fn open(
    clock: VirtualClock,
    down: LinkSettings,
    up: LinkSettings,
    seed: u64,
) -> Result<Opening, TcpUnsupported> {
    let (down_delay_ns, up_delay_ns) = (down.delay_ns, up.delay_ns);
    let mut down_tcp = TcpDirection::new(down, up_delay_ns, seed)?;
    let mut up_tcp = TcpDirection::new(up, down_delay_ns, !seed)?;
    let asked_ns = up_tcp.send_bare(clock.now_ns());
    let client_ready_ns = down_tcp.send_bare(asked_ns);
    let server_ready_ns = up_tcp.send_bare(client_ready_ns);
    let share = |tcp| {
        Arc::new(Mutex::new(Direction {
            tcp,
            reader: None,
            writer: None,
            reader_gone: false,
            received_bytes: 0,
            trace: Trace::default(),
        }))
    };
    let (down, up) = (share(down_tcp), share(up_tcp));
    let end = |incoming: &Shared, outgoing: &Shared| StreamEnd {
        clock,
        incoming: incoming.clone(),
        outgoing: outgoing.clone(),
        read_timer: None,
        write_timer: None,
    };
    Ok(Opening {
        client: end(&down, &up),
        server: end(&up, &down),
        client_ready_ns,
        server_ready_ns,
        counters: StreamCounters { down, up },
    })
}

/// Polls a timer for `at_ns`, resetting it if it was for another time. Ready once that time has come.
fn poll_timer(
    slot: &mut Option<Pin<Box<Sleep>>>,
    clock: VirtualClock,
    at_ns: u64,
    context: &mut Context<'_>,
) -> Poll<()> {
    let deadline = clock.instant(at_ns);
    let timer = slot.get_or_insert_with(|| Box::pin(clock.sleep_until(at_ns)));
    if timer.deadline() != deadline {
        timer.as_mut().reset(deadline);
    }
    let poll = timer.as_mut().poll(context);
    if poll.is_ready() {
        *slot = None;
    }
    poll
}

impl AsyncRead for StreamEnd {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let this = &mut *self;
        if buffer.remaining() == 0 {
            return Poll::Ready(Ok(()));
        }
        let mut direction = lock(&this.incoming);
        loop {
            let now_ns = this.clock.now_ns();
            let count = direction.tcp.receive(now_ns, buffer.initialize_unfilled());
            if count > 0 {
                buffer.advance(count);
                direction.received_bytes += count as u64;
                // The receive window has room again.
                if let Some(writer) = direction.writer.take() {
                    writer.wake();
                }
                return Poll::Ready(Ok(()));
            }
            if direction.tcp.is_finished(now_ns) {
                return Poll::Ready(Ok(()));
            }
            direction.reader = Some(context.waker().clone());
            let Some(at_ns) = direction.tcp.next_arrival_ns() else {
                return Poll::Pending;
            };
            if poll_timer(&mut this.read_timer, this.clock, at_ns, context).is_pending() {
                return Poll::Pending;
            }
        }
    }
}

impl AsyncWrite for StreamEnd {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        data: &[u8],
    ) -> Poll<io::Result<usize>> {
        let this = &mut *self;
        let mut direction = lock(&this.outgoing);
        loop {
            if direction.reader_gone {
                return Poll::Ready(Err(io::ErrorKind::BrokenPipe.into()));
            }
            let now_ns = this.clock.now_ns();
            let sent = direction.tcp.send(now_ns, data);
            if sent > 0 || data.is_empty() {
                direction.trace.add(now_ns);
                direction.trace.add(sent as u64);
                if let Some(reader) = direction.reader.take() {
                    reader.wake();
                }
                return Poll::Ready(Ok(sent));
            }
            direction.writer = Some(context.waker().clone());
            let Some(at_ns) = direction.tcp.next_room_ns(now_ns) else {
                return Poll::Pending;
            };
            if poll_timer(&mut this.write_timer, this.clock, at_ns, context).is_pending() {
                return Poll::Pending;
            }
        }
    }

    fn poll_flush(self: Pin<&mut Self>, _context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _context: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.finish();
        Poll::Ready(Ok(()))
    }
}

impl StreamEnd {
    fn finish(&self) {
        let mut direction = lock(&self.outgoing);
        direction.tcp.finish(self.clock.now_ns());
        if let Some(reader) = direction.reader.take() {
            reader.wake();
        }
    }
}

impl Drop for StreamEnd {
    fn drop(&mut self) {
        self.finish();
        let mut direction = lock(&self.incoming);
        direction.reader_gone = true;
        if let Some(writer) = direction.writer.take() {
            writer.wake();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::virtual_runtime;
    use crate::tcp::{IP_TCP_BYTES, SEGMENT_BYTES};
    use std::num::NonZeroU64;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};

    fn settings(rate: u64) -> LinkSettings {
        LinkSettings::constant(NonZeroU64::new(rate).unwrap(), 25_000_000, 64 * 1024, IP_TCP_BYTES)
    }

    #[test]
    fn bytes_arrive_in_order_at_the_links_rate() {
        virtual_runtime().unwrap().block_on(async {
            let clock = VirtualClock::start();
            let Opening { mut client, mut server, client_ready_ns, counters, .. } =
                open(clock, settings(2_000_000), settings(2_000_000), 1).unwrap();
            // One round trip and two packets of 52 bytes.
            assert_eq!(client_ready_ns, 50_000_000 + 2 * 52 * 4000);
            let bytes = 200 * SEGMENT_BYTES;
            let sent: Vec<u8> = (0..bytes).map(|i| (i % 251) as u8).collect();
            let expected = sent.clone();
            let writer = tokio::spawn(async move {
                server.write_all(&sent).await.unwrap();
                server.shutdown().await.unwrap();
                server
            });
            let mut received = Vec::new();
            client.read_to_end(&mut received).await.unwrap();
            assert!(received == expected);
            assert_eq!(counters.client_received_bytes(), bytes as u64);
            // The handshake's answer occupies the link until 25 ms and two bare packets; then 200
            // segments of 6 ms, the bare packet that ends the stream, the delay, up to 1 ms late.
            let end_ns = 25_000_000 + 2 * 208_000 + 200 * 6_000_000 + 208_000 + 25_000_000;
            assert!((end_ns..=end_ns + 1_000_000).contains(&clock.now_ns()), "{}", clock.now_ns());
            drop(writer.await.unwrap());
        });
    }

    #[test]
    fn writing_to_a_dropped_end_fails_and_reading_ends() {
        virtual_runtime().unwrap().block_on(async {
            let clock = VirtualClock::start();
            let Opening { client, mut server, .. } =
                open(clock, settings(8_000_000), settings(8_000_000), 1).unwrap();
            let blocked = tokio::spawn(async move {
                let error = server.write_all(&vec![0; 1 << 22]).await.unwrap_err();
                let mut rest = Vec::new();
                server.read_to_end(&mut rest).await.unwrap();
                (error.kind(), rest.len())
            });
            clock.sleep_until(200_000_000).await;
            drop(client);
            assert_eq!(blocked.await.unwrap(), (io::ErrorKind::BrokenPipe, 0));
        });
    }
}
