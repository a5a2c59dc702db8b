//! Goodput of a server over a link, and the delay of an urgent blob behind bulk, in virtual time.
//!
//! The server is the shipped one, with its sessions, scheduler, limiter and transports. The client (`client`) is
//! minimal: it requests more than the link carries and reads what arrives. Each case is measured in three runs:
//!
//! - *cold*: one blob of a million bytes, requested as soon as the connection is open;
//! - *steady*: bulk only; the bytes of ten seconds, after a warm-up of two;
//! - *urgent*: the same, and every half second a blob of 8,000 bytes with the highest priority; the time from its
//!   request until its last byte.
//!
//! Shares are of the link's rate. "Payload" counts bytes of blobs, "wire" whole IP packets.

mod case;
mod client;
mod scene;

use std::sync::Arc;

use anyhow::Context as _;
use lodestream_daemon::{Certificate, ServerState, SessionSettings};
use lodestream_netsim::clock::{VirtualClock, virtual_runtime};
use serde::Serialize;

use crate::plan::Transport;
use crate::run::certificate;
use crate::timeline::milliseconds;
pub use case::Case;
use client::Client;
use scene::{BulkScene, COLD_BYTES, URGENT_BLOBS, bulk, cold, urgent};

const S: u64 = 1_000_000_000;
/// Time before anything is counted.
const WARM_UP_NS: u64 = 2 * S;
/// Time over which bytes are counted.
const WINDOW_NS: u64 = 10 * S;
/// Interval between two urgent blobs.
const URGENT_EVERY_NS: u64 = S / 2;
/// Priorities are the bits of a positive `f32`: a blob overtakes if its priority is more than twice that of bulk.
const BULK_PRIORITY: u32 = 1;
const URGENT_PRIORITY: u32 = u32::MAX / 4;
/// Time after which a run is aborted; a million bytes at 64 kbit/s arrive sooner.
const LIMIT_NS: u64 = 600 * S;

/// The results of a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Goodput {
    /// Transport between client and server.
    pub transport: Transport,
    /// Rate of the link.
    pub rate_bits_per_s: u64,
    /// Round trip without queueing.
    pub rtt_ms: u64,
    /// Queue length of the link.
    pub queue_bytes: u64,
    /// The server's limit as a share of the rate.
    pub limiter_share: Option<f64>,
    /// Time from the connect call until a million bytes had arrived.
    pub cold_ms: f64,
    /// Goodput over that time.
    pub cold_share: f64,
    /// Time from the request until they had arrived.
    pub cold_asked_ms: f64,
    /// Goodput over that time.
    pub cold_asked_share: f64,
    /// Bulk only: payload, as a share of the link's rate.
    pub steady_share: f64,
    /// The same including headers and retransmissions.
    pub steady_wire_share: f64,
    /// Packets dropped at a full queue until the end of the window.
    pub steady_packets_dropped: u64,
    /// With urgent blobs: payload of all blobs.
    pub urgent_share: f64,
    /// Median delay of the urgent blobs.
    pub urgent_p50_ms: f64,
    /// Longest delay of the urgent blobs.
    pub urgent_max_ms: f64,
}

/// Measures a case.
///
/// # Errors
/// Connections that fail, and runs that do not end in time.
pub fn measure(case: &Case) -> anyhow::Result<Goodput> {
    let certificate = certificate()?;
    let [cold_ns, cold_asked_ns] =
        in_virtual_time(case, &certificate, async |client| run_cold(client).await)?;
    let steady = in_virtual_time(case, &certificate, async |client| run_bulk(client, false).await)?;
    let urgent = in_virtual_time(case, &certificate, async |client| run_bulk(client, true).await)?;
    let mut waits = urgent.waits_ns;
    waits.sort_unstable();
    let place = |i: usize| waits.get(i).map_or(f64::INFINITY, |ns| milliseconds(*ns));
    Ok(Goodput {
        transport: case.transport,
        rate_bits_per_s: case.rate_bits_per_s.get(),
        rtt_ms: case.rtt_ms,
        queue_bytes: case.queue_bytes,
        limiter_share: case.limiter_share,
        cold_ms: milliseconds(cold_ns),
        cold_share: case.share(f64::from(COLD_BYTES), cold_ns),
        cold_asked_ms: milliseconds(cold_asked_ns),
        cold_asked_share: case.share(f64::from(COLD_BYTES), cold_asked_ns),
        steady_share: case.share(steady.payload_bytes as f64, WINDOW_NS),
        steady_wire_share: case.share(steady.wire_bytes, WINDOW_NS),
        steady_packets_dropped: steady.packets_dropped,
        urgent_share: case.share(urgent.payload_bytes as f64, WINDOW_NS),
        urgent_p50_ms: place(waits.len().div_ceil(2).max(1) - 1),
        urgent_max_ms: place(waits.len().max(1) - 1),
    })
}

/// Runs a future with a client connected to its own server.
fn in_virtual_time<T>(
    case: &Case,
    certificate: &Certificate,
    run: impl AsyncFnOnce(&mut Client) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    virtual_runtime().context("no runtime for virtual time")?.block_on(async {
        let clock = VirtualClock::start();
        let settings =
            SessionSettings { rate_bits_per_s: case.limiter_bits_per_s(), ..SessionSettings::default() };
        let state = ServerState::new(Arc::new(BulkScene::new()), settings);
        let limit = clock.sleep_until(LIMIT_NS);
        let work = async {
            let mut client = Client::connect(case, clock, &state, certificate).await?;
            run(&mut client).await
        };
        let done = tokio::select! {
            biased;
            done = work => done,
            () = limit => Err(anyhow::anyhow!("no end after {} s of virtual time", LIMIT_NS / S)),
        };
        state.stop();
        done
    })
}

/// Time until the cold blob has arrived: since the connect call, and since the request.
async fn run_cold(client: &mut Client) -> anyhow::Result<[u64; 2]> {
    let asked_ns = client.clock.now_ns();
    client.want(&[cold()], BULK_PRIORITY).await?;
    loop {
        let arrival = client.next().await?;
        if arrival.id == cold() && arrival.last {
            return Ok([arrival.at_ns, arrival.at_ns - asked_ns]);
        }
    }
}

/// Bytes that arrived within the window.
#[derive(Debug, Default)]
struct Bulk {
    payload_bytes: u64,
    wire_bytes: f64,
    packets_dropped: u64,
    /// Delay of each urgent blob.
    waits_ns: Vec<u64>,
}

async fn run_bulk(client: &mut Client, with_urgent: bool) -> anyhow::Result<Bulk> {
    const END_NS: u64 = WARM_UP_NS + WINDOW_NS;
    client.want(&bulk(), BULK_PRIORITY).await?;
    let mut found = Bulk::default();
    let mut asked_ns = Vec::new();
    let urgent_blobs = if with_urgent { URGENT_BLOBS } else { 0 };
    let mut at_start = None;
    let mut over = false;
    // The next event: an end of the window, or an urgent request.
    let mut next_ns = WARM_UP_NS;
    // The last urgent blobs may still be on their way at the end of the window.
    while !over || found.waits_ns.len() < asked_ns.len() {
        tokio::select! {
            biased;
            () = client.clock.sleep_until(next_ns), if !over => {
                let now = client.clock.now_ns();
                let wire_bytes = client.wire_bytes();
                let before = *at_start.get_or_insert(wire_bytes);
                if now >= END_NS {
                    over = true;
                    found.wire_bytes = wire_bytes - before;
                    found.packets_dropped = client.downlink().queue_full;
                } else if asked_ns.len() < urgent_blobs as usize {
                    client.want(&[urgent(u32::try_from(asked_ns.len())?)], URGENT_PRIORITY).await?;
                    asked_ns.push(now);
                    next_ns = (now + URGENT_EVERY_NS).min(END_NS);
                } else {
                    next_ns = END_NS;
                }
            }
            arrival = client.next() => {
                let arrival = arrival?;
                if (WARM_UP_NS..END_NS).contains(&arrival.at_ns) {
                    found.payload_bytes += arrival.bytes;
                }
                let asked = (0..).zip(&asked_ns).find(|(number, _)| urgent(*number) == arrival.id);
                if let Some((_, asked_ns)) = asked.filter(|_| arrival.last) {
                    found.waits_ns.push(arrival.at_ns - asked_ns);
                }
            }
        }
    }
    Ok(found)
}

impl std::fmt::Display for Goodput {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let limiter = self.limiter_share.map_or("off".to_owned(), |share| share.to_string());
        write!(
            f,
            "{}, {} Mbit/s, RTT {} ms, queue {} bytes, limiter {limiter}: cold {:.1} % ({:.1} % since asked), steady {:.1} % \
             ({:.1} % with headers), with urgent blobs {:.1} %, of which half wait at most {:.0} ms, all {:.0} ms",
            self.transport,
            self.rate_bits_per_s as f64 / 1e6,
            self.rtt_ms,
            self.queue_bytes,
            self.cold_share * 100.0,
            self.cold_asked_share * 100.0,
            self.steady_share * 100.0,
            self.steady_wire_share * 100.0,
            self.urgent_share * 100.0,
            self.urgent_p50_ms,
            self.urgent_max_ms
        )
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroU64;

    use super::*;

    fn case(transport: Transport, limiter_share: Option<f64>) -> Case {
        let rate_bits_per_s = NonZeroU64::new(2_000_000).unwrap();
        Case { transport, rate_bits_per_s, rtt_ms: 50, queue_bytes: 512_000, limiter_share }
    }

    #[test]
    fn a_limit_below_the_rate_keeps_the_queue_short_and_the_link_full() {
        for transport in [Transport::Quic, Transport::Ws] {
            let found = measure(&case(transport, Some(0.95))).unwrap();
            // A round trip and the blob's own transfer time.
            assert!((82.0..=120.0).contains(&found.urgent_max_ms), "{found}");
            assert!(found.steady_share > 0.85 && found.steady_wire_share <= 1.0, "{found}");
            assert!(found.urgent_share > 0.85 && found.steady_packets_dropped == 0, "{found}");
            // A million bytes take four seconds.
            assert!((4000.0..5000.0).contains(&found.cold_asked_ms), "{found}");
            assert!(found.cold_ms > found.cold_asked_ms + 49.0, "{found}");
            assert_eq!(measure(&case(transport, Some(0.95))).unwrap(), found);
        }
    }

    #[test]
    fn without_a_limit_urgent_blobs_wait_in_the_queue_over_tcp_but_not_over_quic() {
        let quic = measure(&case(Transport::Quic, None)).unwrap();
        assert!(quic.urgent_max_ms < 200.0 && quic.steady_wire_share > 0.98, "{quic}");
        let ws = measure(&case(Transport::Ws, None)).unwrap();
        assert!(ws.urgent_max_ms > 200.0 && ws.steady_wire_share > 0.98, "{ws}");
    }
}
