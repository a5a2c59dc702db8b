//! One direction of a link: packets in, arrival times out, in integer nanoseconds of virtual time.
//!
//! Modelled, in this order: the largest packet ([`Fate::TooBig`]); a queue limited in bytes that drops what does not
//! fit (drop tail); a [`rate`](Rate), constant or varying, at which packets are serialised, headers included; [`Loss`],
//! by packet or in bursts, after serialisation; a one-way delay with [`Jitter`].
//!
//! Not modelled: duplication, corruption, cross traffic, active queue management, layers below IP.

mod jitter;
mod loss;
mod rate;
#[cfg(test)]
mod tests;

use std::num::NonZeroU64;

use jitter::Delays;
pub use jitter::Jitter;
use loss::Losses;
pub use loss::{GilbertElliott, Loss};
pub use rate::{AtEnd, MAX_RATE_BITS_PER_S, NS_PER_S, Rate, RateError};

/// Header bytes of an IPv4 packet with a UDP datagram.
pub const IP_UDP_BYTES: u32 = 20 + 8;

/// Largest IP packet on Ethernet.
pub const ETHERNET_MTU_BYTES: u32 = 1500;

/// Settings of a link, in one direction.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkSettings {
    /// Bits per second, headers included.
    pub rate: Rate,
    /// One-way delay of a packet after its last bit was sent.
    pub delay_ns: u64,
    /// Jitter added to the delay.
    pub jitter: Jitter,
    /// Most bytes waiting or being sent, headers included; excess packets are dropped. An idle link accepts any packet.
    pub queue_bytes: u64,
    /// Loss of packets that were sent.
    pub loss: Loss,
    /// Bytes of headers per packet.
    pub overhead_bytes: u32,
    /// Largest packet that passes, headers included.
    pub mtu_bytes: u32,
}

impl LinkSettings {
    /// A link with a constant rate and delay, Ethernet's packets, and no loss.
    #[must_use]
    pub fn constant(
        rate_bits_per_s: NonZeroU64,
        delay_ns: u64,
        queue_bytes: u64,
        overhead_bytes: u32,
    ) -> Self {
        Self {
            rate: Rate::constant(rate_bits_per_s),
            delay_ns,
            jitter: Jitter::default(),
            queue_bytes,
            loss: Loss::NONE,
            overhead_bytes,
            mtu_bytes: ETHERNET_MTU_BYTES,
        }
    }
}

/// Fate of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It arrives at this time.
    Arrives {
        /// Virtual time of its arrival.
        at_ns: u64,
    },
    /// It was sent and lost.
    Lost,
    /// The queue was full.
    QueueFull,
    /// It is larger than [`LinkSettings::mtu_bytes`].
    TooBig,
}

/// Counts of packets and payload bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounters {
    /// Packets handed to the link.
    pub offered: u64,
    /// Packets that arrive.
    pub arrived: u64,
    /// Packets lost on the way.
    pub lost: u64,
    /// Packets that found the queue full.
    pub queue_full: u64,
    /// Packets above the largest size.
    pub too_big: u64,
    /// Payload of the packets that were sent, arriving or lost, without headers.
    pub sent_payload_bytes: u64,
    /// Payload of the packets that arrive, without headers.
    pub arrived_payload_bytes: u64,
    /// Most bytes that ever waited, headers included.
    pub longest_queue_bytes: u64,
}

/// One direction of a link.
#[derive(Clone, Debug)]
pub struct Link {
    settings: LinkSettings,
    losses: Losses,
    delays: Delays,
    /// When the last packet's last bit is sent, in whole nanoseconds …
    busy_until_ns: u64,
    /// … and how much of the next one it takes, in units of 1/rate nanoseconds, so that no rate drifts by
    /// rounding.
    busy_remainder: u64,
    counters: LinkCounters,
}

impl Link {
    /// An idle link; `seed` determines losses and jitter.
    #[must_use]
    pub fn new(settings: LinkSettings, seed: u64) -> Self {
        Self {
            losses: Losses::new(settings.loss, seed),
            delays: Delays::new(settings.jitter, seed),
            settings,
            busy_until_ns: 0,
            busy_remainder: 0,
            counters: LinkCounters::default(),
        }
    }

    /// The link's settings.
    #[must_use]
    pub fn settings(&self) -> &LinkSettings {
        &self.settings
    }

    /// Counters so far.
    #[must_use]
    pub fn counters(&self) -> LinkCounters {
        self.counters
    }

    /// When all accepted packets have been sent.
    #[must_use]
    pub fn idle_from_ns(&self) -> u64 {
        self.busy_until_ns.saturating_add(u64::from(self.busy_remainder > 0))
    }

    /// Bytes that wait or are being sent at `now_ns`, headers included, rounded up.
    #[must_use]
    pub fn backlog_bytes(&self, now_ns: u64) -> u64 {
        if self.idle_from_ns() <= now_ns {
            return 0;
        }
        let work = self.settings.rate.work_between(now_ns, self.busy_until_ns);
        saturate((work + u128::from(self.busy_remainder)).div_ceil(8 * u128::from(NS_PER_S)))
    }

    /// Offers a packet at `now_ns`, which must not be earlier than in previous calls.
    pub fn offer(&mut self, now_ns: u64, payload_bytes: usize) -> Fate {
        let (lost, jitter_ns) = (self.losses.next_is_lost(), self.delays.draw_ns());
        self.counters.offered += 1;
        let wire_bytes = payload_bytes as u64 + u64::from(self.settings.overhead_bytes);
        if wire_bytes > u64::from(self.settings.mtu_bytes) {
            self.counters.too_big += 1;
            return Fate::TooBig;
        }
        let backlog = self.backlog_bytes(now_ns);
        if backlog > 0 && backlog + wire_bytes > self.settings.queue_bytes {
            self.counters.queue_full += 1;
            return Fate::QueueFull;
        }
        self.counters.longest_queue_bytes = self.counters.longest_queue_bytes.max(backlog + wire_bytes);
        self.send(now_ns, wire_bytes);
        self.counters.sent_payload_bytes += payload_bytes as u64;
        if lost {
            self.counters.lost += 1;
            return Fate::Lost;
        }
        self.counters.arrived += 1;
        self.counters.arrived_payload_bytes += payload_bytes as u64;
        let delay_ns = self.settings.delay_ns.saturating_add(jitter_ns);
        let at_ns = self.delays.arrival_ns(self.idle_from_ns().saturating_add(delay_ns));
        Fate::Arrives { at_ns }
    }

    /// Extends the time until which the link is busy by the bits of one packet.
    fn send(&mut self, now_ns: u64, wire_bytes: u64) {
        if self.busy_until_ns < now_ns {
            self.busy_until_ns = now_ns;
            self.busy_remainder = 0;
        }
        let work = u128::from(wire_bytes) * 8 * u128::from(NS_PER_S) + u128::from(self.busy_remainder);
        (self.busy_until_ns, self.busy_remainder) = self.settings.rate.done(self.busy_until_ns, work);
    }
}

fn saturate(value: u128) -> u64 {
    u64::try_from(value).unwrap_or(u64::MAX)
}
