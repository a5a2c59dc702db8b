//! One direction of a link: packets in, arrival times out, in integer nanoseconds of virtual time.
//!
//! Modelled: a rate, at which packets are serialised one after the other; a queue before it, limited
//! in bytes, that drops what does not fit (drop tail); a constant one-way delay after it; random
//! loss, each packet independently; bytes of headers that each packet costs besides its payload;
//! the largest packet that fits.
//!
//! Not modelled: jitter, reordering, duplication, corruption, bursts of loss, cross traffic, active
//! queue management, layers below IP.

use std::num::NonZeroU64;

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Header bytes of an IPv4 packet with a UDP datagram.
pub const IP_UDP_BYTES: u32 = 20 + 8;

/// Largest IP packet that passes: Ethernet's.
pub const MTU_BYTES: u32 = 1500;

/// Nanoseconds per second.
pub const NS_PER_S: u64 = 1_000_000_000;

/// What a link is like, in one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkSettings {
    /// Bits per second, headers included.
    pub rate_bits_per_s: NonZeroU64,
    /// One-way delay of a packet after its last bit was sent.
    pub delay_ns: u64,
    /// Bytes that may wait or be in the middle of being sent, headers included; what does not fit is
    /// dropped. An idle link takes any packet.
    pub queue_bytes: u64,
    /// Probability that a packet that was sent does not arrive; 0 to 1.
    pub loss: f64,
    /// Bytes of headers per packet.
    pub overhead_bytes: u32,
}

/// What became of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It arrives at this time.
    Arrives {
        /// Virtual time of its arrival.
        at_ns: u64,
    },
    /// It was sent and lost on the way.
    Lost,
    /// The queue was full.
    QueueFull,
    /// It is larger than [`MTU_BYTES`].
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
    random: Pcg64Mcg,
    /// When the last packet's last bit has been sent: whole nanoseconds …
    busy_until_ns: u64,
    /// … and a remainder in units of 1/rate nanoseconds, so that no rate drifts by rounding.
    busy_remainder: u64,
    counters: LinkCounters,
}

impl Link {
    /// An idle link; `seed` decides which packets are lost.
    #[must_use]
    pub fn new(settings: LinkSettings, seed: u64) -> Self {
        Self {
            settings,
            random: Pcg64Mcg::seed_from_u64(seed),
            busy_until_ns: 0,
            busy_remainder: 0,
            counters: LinkCounters::default(),
        }
    }

    /// What the link is like.
    #[must_use]
    pub fn settings(&self) -> &LinkSettings {
        &self.settings
    }

    /// What has happened so far.
    #[must_use]
    pub fn counters(&self) -> LinkCounters {
        self.counters
    }

    /// Bytes that wait or are being sent at `now_ns`, headers included, rounded up.
    #[must_use]
    pub fn backlog_bytes(&self, now_ns: u64) -> u64 {
        let bit_ns = u128::from(self.busy_until_ns.saturating_sub(now_ns))
            * u128::from(self.settings.rate_bits_per_s.get());
        saturate(bit_ns.div_ceil(8 * u128::from(NS_PER_S)))
    }

    /// Hands over a packet at `now_ns`, which must not be earlier than in any call before.
    pub fn offer(&mut self, now_ns: u64, payload_bytes: usize) -> Fate {
        // One number is drawn for every packet, whatever becomes of it: which packets are lost then
        // depends on their place in the sequence and on nothing else.
        let lost = self.random.random::<f64>() < self.settings.loss;
        self.counters.offered += 1;
        let wire_bytes = payload_bytes as u64 + u64::from(self.settings.overhead_bytes);
        if wire_bytes > u64::from(MTU_BYTES) {
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
        let sent_ns = self.busy_until_ns + u64::from(self.busy_remainder > 0);
        Fate::Arrives { at_ns: sent_ns.saturating_add(self.settings.delay_ns) }
    }

    /// Moves the time until which the link is busy by the bits of one packet.
    fn send(&mut self, now_ns: u64, wire_bytes: u64) {
        if self.busy_until_ns < now_ns {
            self.busy_until_ns = now_ns;
            self.busy_remainder = 0;
        }
        let rate = u128::from(self.settings.rate_bits_per_s.get());
        let bit_ns = u128::from(wire_bytes) * 8 * u128::from(NS_PER_S) + u128::from(self.busy_remainder);
        self.busy_until_ns = self.busy_until_ns.saturating_add(saturate(bit_ns / rate));
        // Below the rate, which is a u64.
        self.busy_remainder = (bit_ns % rate) as u64;
    }
}

fn saturate(value: u128) -> u64 {
    u64::try_from(value).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn settings(rate: u64, loss: f64) -> LinkSettings {
        LinkSettings {
            rate_bits_per_s: NonZeroU64::new(rate).unwrap(),
            delay_ns: 25 * MS,
            queue_bytes: 64 * 1024,
            loss,
            overhead_bytes: IP_UDP_BYTES,
        }
    }

    #[test]
    fn packets_arrive_when_theory_says() {
        // At 2 Mbit/s a byte takes 4 µs. Three packets of 1,000 bytes with headers at once, and one
        // after the link fell idle.
        let mut link = Link::new(settings(2_000_000, 0.0), 1);
        for i in 1..=3 {
            assert_eq!(link.offer(0, 972), Fate::Arrives { at_ns: i * 4 * MS + 25 * MS });
        }
        assert_eq!(link.backlog_bytes(0), 3000);
        assert_eq!(link.backlog_bytes(5 * MS), 1750);
        assert_eq!(link.offer(20 * MS, 472), Fate::Arrives { at_ns: 20 * MS + 2 * MS + 25 * MS });
        assert_eq!(link.counters().arrived_payload_bytes, 3 * 972 + 472);
    }

    #[test]
    fn rates_that_do_not_divide_a_nanosecond_do_not_drift() {
        // 300,000 packets of 1,000 bytes at 7 Mbit/s, offered as fast as they are sent.
        let mut link = Link::new(settings(7_000_000, 0.0), 1);
        let mut last = 0;
        for i in 0..300_000u64 {
            let Fate::Arrives { at_ns } = link.offer(i * 8_000_000 / 7, 972) else { panic!("{i}") };
            last = at_ns;
        }
        assert_eq!(last, (300_000u64 * 8_000_000).div_ceil(7) + 25 * MS);
    }

    #[test]
    fn the_queue_drops_its_tail_and_drains_at_the_rate() {
        let mut link = Link::new(settings(2_000_000, 0.0), 1);
        let taken = (0..100).filter(|_| link.offer(0, 1472) != Fate::QueueFull).count();
        assert_eq!(taken, 64 * 1024 / 1500);
        assert_eq!(link.counters().queue_full, 100 - taken as u64);
        // One packet's time later there is room for one packet.
        assert!(matches!(link.offer(6 * MS, 1472), Fate::Arrives { .. }));
        assert_eq!(link.offer(6 * MS, 1472), Fate::QueueFull);
        assert!(link.counters().longest_queue_bytes <= 64 * 1024);
    }

    #[test]
    fn an_idle_link_takes_a_packet_without_any_queue() {
        let mut link = Link::new(LinkSettings { queue_bytes: 0, ..settings(8_000_000, 0.0) }, 1);
        assert!(matches!(link.offer(0, 972), Fate::Arrives { .. }));
        assert_eq!(link.offer(0, 0), Fate::QueueFull);
        assert!(matches!(link.offer(MS, 972), Fate::Arrives { .. }));
    }

    #[test]
    fn packets_above_the_mtu_do_not_pass() {
        let mut link = Link::new(settings(8_000_000, 0.0), 1);
        assert_eq!(link.offer(0, 1473), Fate::TooBig);
        assert!(matches!(link.offer(0, 1472), Fate::Arrives { .. }));
    }

    #[test]
    fn loss_is_near_its_nominal_rate_and_takes_up_the_link() {
        for (loss, seed) in [(0.01, 1), (0.01, 2), (0.3, 3)] {
            let mut link = Link::new(settings(1_000_000_000, loss), seed);
            let packets = 200_000u64;
            for i in 0..packets {
                link.offer(i * 8_000, 972);
            }
            let found = link.counters().lost as f64 / packets as f64;
            // Four standard deviations of a binomial distribution.
            let slack = 4.0 * (loss * (1.0 - loss) / packets as f64).sqrt();
            assert!((found - loss).abs() < slack, "{found} for {loss}");
            assert_eq!(link.backlog_bytes((packets - 1) * 8_000), 1000);
        }
    }

    #[test]
    fn loss_depends_on_the_seed_alone() {
        let fates = |seed, gap| {
            let mut link = Link::new(settings(2_000_000, 0.1), seed);
            (0..1000u64).map(|i| link.offer(i * gap, 972) == Fate::Lost).collect::<Vec<_>>()
        };
        assert_eq!(fates(5, 10 * MS), fates(5, 4 * MS));
        assert_ne!(fates(5, 10 * MS), fates(6, 10 * MS));
    }
}
