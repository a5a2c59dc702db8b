//! One direction of a TCP connection over a link without loss: arrival time of each byte.
//!
//! Modelled: segments of the link's MTU with headers; slow start from ten segments (RFC 6928, RFC 5681 §3.1) without
//! delayed acknowledgements; a congestion window that stops growing at the bandwidth–delay product (at the highest
//! rate) plus the queue, as if the sender knew them; a sender that waits while the link's queue is full, so that it
//! never overflows; a receive window; acknowledgements that arrive after the reverse delay, without bandwidth or
//! jitter.
//!
//! Not modelled: loss and reordering (links with either are refused), congestion avoidance, delayed acknowledgements,
//! Nagle's algorithm (assumed off), a send buffer larger than the congestion window, window scaling, slow start after
//! idle. A real sender that overshoots the queue and recovers is slower than this one.

use std::collections::VecDeque;

use bytes::Bytes;

use crate::link::{ETHERNET_MTU_BYTES, Fate, Link, LinkCounters, LinkSettings, Loss, NS_PER_S};

/// Headers of a segment: IPv4, TCP, timestamps.
pub const IP_TCP_BYTES: u32 = 20 + 20 + 12;

/// Payload of a full segment on Ethernet: 1500 bytes less the headers.
pub const SEGMENT_BYTES: usize = (ETHERNET_MTU_BYTES - IP_TCP_BYTES) as usize;

/// Most bytes in flight or not yet read.
const RECEIVE_WINDOW_BYTES: u64 = 1 << 20;

/// A feature of a link that the TCP model lacks.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TcpUnsupported {
    /// Loss, random or in bursts.
    #[error("loss {loss} over TCP: loss recovery is not modelled, so the loss must be 0")]
    Loss {
        /// Its long-run share.
        loss: f64,
    },
    /// Jitter that reorders packets.
    #[error("jitter that changes the order over TCP: recovery from that is not modelled; keep the order")]
    Reordering,
    /// Packets too small for headers and a byte.
    #[error("an MTU of {mtu_bytes} bytes leaves TCP no room for data")]
    Mtu {
        /// Largest packet.
        mtu_bytes: u32,
    },
}

/// Initial congestion window (RFC 6928, §2).
fn initial_window_bytes(segment: u64) -> u64 {
    (10 * segment).min((2 * segment).max(14_600))
}

/// One direction of a TCP connection.
#[derive(Debug)]
pub struct TcpDirection {
    link: Link,
    segment_bytes: usize,
    /// Delay of acknowledgements.
    reverse_delay_ns: u64,
    congestion_window_bytes: u64,
    largest_window_bytes: u64,
    /// Bytes sent and not yet acknowledged: arrival time of the acknowledgement, number of bytes.
    unacknowledged: VecDeque<(u64, u64)>,
    flight_bytes: u64,
    /// Data sent and not yet read, with arrival time.
    arriving: VecDeque<(u64, Bytes)>,
    unread_bytes: u64,
    /// Arrival time of the end of the stream, once it was sent.
    end_ns: Option<u64>,
}

impl TcpDirection {
    /// An idle direction; `seed` determines jitter.
    ///
    /// # Errors
    /// Links with loss or reordering, and packets without room for data.
    pub fn new(settings: LinkSettings, reverse_delay_ns: u64, seed: u64) -> Result<Self, TcpUnsupported> {
        if settings.loss != Loss::NONE {
            return Err(TcpUnsupported::Loss { loss: settings.loss.long_run() });
        }
        if settings.jitter.reorders && settings.jitter.largest_ns > 0 {
            return Err(TcpUnsupported::Reordering);
        }
        let segment = u64::from(settings.mtu_bytes.saturating_sub(settings.overhead_bytes));
        if segment == 0 {
            return Err(TcpUnsupported::Mtu { mtu_bytes: settings.mtu_bytes });
        }
        let round_trip_ns = u128::from(settings.delay_ns) + u128::from(reverse_delay_ns);
        let product_bytes = u128::from(settings.rate.largest()) * round_trip_ns / (8 * u128::from(NS_PER_S));
        let largest = u64::try_from(product_bytes)
            .unwrap_or(u64::MAX)
            .saturating_add(settings.queue_bytes)
            .clamp(2 * segment, RECEIVE_WINDOW_BYTES.max(2 * segment));
        Ok(Self {
            link: Link::new(settings, seed),
            // From a u32.
            segment_bytes: segment as usize,
            reverse_delay_ns,
            congestion_window_bytes: initial_window_bytes(segment).min(largest),
            largest_window_bytes: largest,
            unacknowledged: VecDeque::new(),
            flight_bytes: 0,
            arriving: VecDeque::new(),
            unread_bytes: 0,
            end_ns: None,
        })
    }

    /// Counters of the link.
    #[must_use]
    pub fn counters(&self) -> LinkCounters {
        self.link.counters()
    }

    /// Sends a packet without payload, as in a handshake, once the queue has room; returns its arrival time.
    pub fn send_bare(&mut self, now_ns: u64) -> u64 {
        let wire_bytes = u64::from(self.link.settings().overhead_bytes);
        let sent_ns = if self.has_room(now_ns, wire_bytes) { now_ns } else { self.link.idle_from_ns() };
        match self.link.offer(sent_ns, 0) {
            Fate::Arrives { at_ns } => at_ns,
            // Unreachable: the queue has room, and there is no loss.
            Fate::Lost | Fate::QueueFull | Fate::TooBig => sent_ns,
        }
    }

    /// Whether the link's queue accepts a packet now.
    fn has_room(&self, now_ns: u64, wire_bytes: u64) -> bool {
        let backlog = self.link.backlog_bytes(now_ns);
        backlog == 0 || backlog + wire_bytes <= self.link.settings().queue_bytes
    }

    /// Sends as much of `data` as the windows allow; returns the number of bytes. After 0 the caller tries again at
    /// [`TcpDirection::next_room_ns`], or once data have been read.
    pub fn send(&mut self, now_ns: u64, data: &[u8]) -> usize {
        self.take_acknowledgements(now_ns);
        let mut sent = 0;
        while sent < data.len() {
            let length = (data.len() - sent).min(self.segment_bytes);
            let bytes = length as u64;
            let wire_bytes = bytes + u64::from(self.link.settings().overhead_bytes);
            if self.flight_bytes + bytes > self.congestion_window_bytes
                || self.unread_bytes + bytes > RECEIVE_WINDOW_BYTES
                || !self.has_room(now_ns, wire_bytes)
            {
                break;
            }
            let Fate::Arrives { at_ns } = self.link.offer(now_ns, length) else { break };
            self.arriving.push_back((at_ns, Bytes::copy_from_slice(&data[sent..sent + length])));
            self.unacknowledged.push_back((at_ns.saturating_add(self.reverse_delay_ns), bytes));
            self.flight_bytes += bytes;
            self.unread_bytes += bytes;
            sent += length;
        }
        sent
    }

    /// Ends the stream after the data sent so far.
    pub fn finish(&mut self, now_ns: u64) {
        if self.end_ns.is_none() {
            let last = self.arriving.back().map_or(0, |&(at_ns, _)| at_ns);
            self.end_ns = Some(self.send_bare(now_ns).max(last));
        }
    }

    /// When a sender that could send nothing at `now_ns` may try again: at the next acknowledgement, or once the link
    /// has sent its queue. `None` if only reading makes room.
    #[must_use]
    pub fn next_room_ns(&self, now_ns: u64) -> Option<u64> {
        let acknowledged = self.unacknowledged.front().map(|&(at_ns, _)| at_ns);
        let idle = Some(self.link.idle_from_ns()).filter(|&at_ns| at_ns > now_ns);
        [acknowledged, idle].into_iter().flatten().min()
    }

    /// Moves the data that arrived by `now_ns` into `buffer`; returns the number of bytes.
    pub fn receive(&mut self, now_ns: u64, buffer: &mut [u8]) -> usize {
        let mut filled = 0;
        while let Some((at_ns, data)) = self.arriving.front_mut() {
            if *at_ns > now_ns || filled == buffer.len() {
                break;
            }
            let length = data.len().min(buffer.len() - filled);
            buffer[filled..filled + length].copy_from_slice(&data.split_to(length));
            filled += length;
            if data.is_empty() {
                self.arriving.pop_front();
            }
        }
        self.unread_bytes -= filled as u64;
        filled
    }

    /// When the next byte, or the end of the stream, arrives.
    #[must_use]
    pub fn next_arrival_ns(&self) -> Option<u64> {
        self.arriving.front().map(|&(at_ns, _)| at_ns).or(self.end_ns)
    }

    /// Whether the receiver has read everything including the end of the stream.
    #[must_use]
    pub fn is_finished(&self, now_ns: u64) -> bool {
        self.arriving.is_empty() && self.end_ns.is_some_and(|end_ns| end_ns <= now_ns)
    }

    /// Slow start: each acknowledged byte allows one more byte in flight.
    fn take_acknowledgements(&mut self, now_ns: u64) {
        while let Some(&(at_ns, bytes)) = self.unacknowledged.front() {
            if at_ns > now_ns {
                break;
            }
            self.unacknowledged.pop_front();
            self.flight_bytes -= bytes;
            self.congestion_window_bytes =
                (self.congestion_window_bytes + bytes).min(self.largest_window_bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::{GilbertElliott, Jitter};
    use std::num::NonZeroU64;

    const MS: u64 = 1_000_000;

    fn settings(rate: u64) -> LinkSettings {
        LinkSettings::constant(NonZeroU64::new(rate).unwrap(), 25 * MS, 64 * 1024, IP_TCP_BYTES)
    }

    /// Sends `bytes` as fast as the windows allow and reads at once; returns when the last arrives.
    fn last_arrival_ns(rate: u64, bytes: usize) -> u64 {
        let mut tcp = TcpDirection::new(settings(rate), 25 * MS, 1).unwrap();
        let mut now_ns = 0;
        let mut sent = 0;
        let mut received = 0;
        let mut buffer = [0; 4096];
        loop {
            let data = vec![1; bytes - sent];
            sent += tcp.send(now_ns, &data);
            received += tcp.receive(now_ns, &mut buffer);
            if received == bytes {
                return now_ns;
            }
            let next = [tcp.next_room_ns(now_ns), tcp.next_arrival_ns()];
            now_ns = next.into_iter().flatten().filter(|&t| t >= now_ns).min().unwrap().max(now_ns);
            tcp.take_acknowledgements(now_ns);
        }
    }

    #[test]
    fn a_slow_link_is_full_from_the_first_byte() {
        // The bandwidth–delay product is 12.5 kB, below the first ten segments: 100 full segments
        // of 6 ms each and the delay.
        assert_eq!(last_arrival_ns(2_000_000, 100 * SEGMENT_BYTES), 600 * MS + 25 * MS);
    }

    #[test]
    fn slow_start_costs_round_trips_on_a_fast_link() {
        // At 1 Gbit/s a segment takes 12 µs: ten segments in the first flight, twenty in the second.
        let segment = 12_000;
        assert_eq!(last_arrival_ns(1_000_000_000, 10 * SEGMENT_BYTES), 10 * segment + 25 * MS);
        let thirty = last_arrival_ns(1_000_000_000, 30 * SEGMENT_BYTES);
        assert!((75 * MS..75 * MS + 40 * segment).contains(&thirty), "{thirty}");
    }

    #[test]
    fn windows_limit_the_bytes_in_flight() {
        let mut tcp = TcpDirection::new(settings(2_000_000), 25 * MS, 1).unwrap();
        let data = vec![0; 1 << 20];
        assert_eq!(tcp.send(0, &data), 10 * SEGMENT_BYTES);
        assert_eq!(tcp.send(0, &data), 0);
        // The first acknowledgement comes after 6 ms and a round trip, and lets two segments out.
        assert_eq!(tcp.next_room_ns(0), Some(56 * MS));
        assert_eq!(tcp.send(56 * MS, &data), 2 * SEGMENT_BYTES);
        let mut buffer = vec![0; 1 << 20];
        assert_eq!(tcp.receive(31 * MS - 1, &mut buffer), 0);
        assert_eq!(tcp.receive(31 * MS, &mut buffer), SEGMENT_BYTES);
    }

    #[test]
    fn an_unread_stream_stops() {
        let mut tcp = TcpDirection::new(settings(1_000_000_000), 25 * MS, 1).unwrap();
        let data = vec![0; 4096];
        let mut sent = 0;
        for step in 0..100_000u64 {
            sent += tcp.send(step * MS, &data);
        }
        assert!(sent as u64 <= RECEIVE_WINDOW_BYTES && sent as u64 > RECEIVE_WINDOW_BYTES - 4096, "{sent}");
    }

    #[test]
    fn the_end_comes_after_the_last_byte() {
        let mut tcp = TcpDirection::new(settings(2_000_000), 25 * MS, 1).unwrap();
        assert_eq!(tcp.send(0, b"abc"), 3);
        tcp.finish(0);
        let mut buffer = [0; 8];
        assert!(!tcp.is_finished(100 * MS));
        assert_eq!(tcp.receive(100 * MS, &mut buffer), 3);
        assert!(tcp.is_finished(100 * MS));
    }

    #[test]
    fn links_that_are_not_modelled_are_refused() {
        let refused = |settings: LinkSettings| TcpDirection::new(settings, 0, 1).unwrap_err();
        let plain = || settings(2_000_000);
        let burst = GilbertElliott { to_bad: 0.1, to_good: 0.3, loss_good: 0.0, loss_bad: 1.0 };
        for (loss, share) in [(Loss::Random(0.01), 0.01), (Loss::Burst(burst), burst.long_run_loss())] {
            assert_eq!(refused(LinkSettings { loss, ..plain() }), TcpUnsupported::Loss { loss: share });
        }
        let jitter = |reorders| Jitter { largest_ns: MS, reorders };
        assert_eq!(refused(LinkSettings { jitter: jitter(true), ..plain() }), TcpUnsupported::Reordering);
        assert!(TcpDirection::new(LinkSettings { jitter: jitter(false), ..plain() }, 0, 1).is_ok());
        assert_eq!(refused(LinkSettings { mtu_bytes: 52, ..plain() }), TcpUnsupported::Mtu { mtu_bytes: 52 });
    }

    #[test]
    fn segments_are_as_large_as_the_link_takes() {
        // 552 bytes at 4 µs each; the first window is ten of them, or 17,896 bytes of jumbo segments.
        let mut small =
            TcpDirection::new(LinkSettings { mtu_bytes: 552, ..settings(2_000_000) }, 25 * MS, 1).unwrap();
        assert_eq!(small.send(0, &[0; 100_000]), 10 * 500);
        assert_eq!(small.next_arrival_ns(), Some(552 * 4_000 + 25 * MS));
        let jumbo = LinkSettings { mtu_bytes: 9000, ..settings(1_000_000_000) };
        let mut jumbo = TcpDirection::new(jumbo, 25 * MS, 1).unwrap();
        assert_eq!(jumbo.send(0, &[0; 100_000]), 2 * 8948);
    }

    #[test]
    fn a_queue_of_one_packet_slows_a_sender_and_does_not_stop_it() {
        // Two segments never fit, so one follows the other as the link falls idle. Nothing is dropped.
        let one = LinkSettings { queue_bytes: 1500, ..settings(2_000_000) };
        let mut tcp = TcpDirection::new(one, 25 * MS, 1).unwrap();
        assert_eq!(tcp.send_bare(0), 208_000 + 25 * MS);
        let data = [0; 10 * SEGMENT_BYTES];
        assert_eq!(tcp.send(0, &data), 0, "the bare packet is still being sent");
        let mut sent_at = Vec::new();
        let (mut now_ns, mut sent) = (0, 0);
        while sent < data.len() {
            now_ns = tcp.next_room_ns(now_ns).unwrap();
            let more = tcp.send(now_ns, &data[sent..]);
            sent_at.extend((more > 0).then_some(now_ns));
            sent += more;
        }
        // The tenth would exceed the window (12,500 bytes of bandwidth–delay product and 1,500 of queue): it
        // waits for the first acknowledgement, 6 ms and a round trip after the first segment.
        let expected = (0..9).map(|i| 208_000 + i * 6 * MS).chain([208_000 + 56 * MS]);
        assert_eq!(sent_at, expected.collect::<Vec<_>>());
        assert_eq!(tcp.counters().longest_queue_bytes, 1500);
        // The end waits for the queue as well.
        tcp.finish(now_ns);
        assert_eq!(tcp.end_ns, Some(now_ns + 6 * MS + 208_000 + 25 * MS));
        assert_eq!(tcp.counters().queue_full, 0);
    }

    #[test]
    fn jitter_delays_segments_and_keeps_their_order() {
        let jitter = Jitter { largest_ns: 30 * MS, reorders: false };
        let mut tcp = TcpDirection::new(LinkSettings { jitter, ..settings(8_000_000) }, 25 * MS, 1).unwrap();
        tcp.send(0, &[0; 10 * SEGMENT_BYTES]);
        let arrivals: Vec<u64> = tcp.arriving.iter().map(|&(at_ns, _)| at_ns).collect();
        assert!(arrivals.is_sorted());
        let smooth = (1..=10).map(|i| i * 1_500_000 + 25 * MS);
        assert!(
            arrivals.iter().zip(smooth).all(|(at, least)| (least..=10 * 1_500_000 + 55 * MS).contains(at))
        );
        assert!(arrivals[0] > 1_500_000 + 25 * MS);
    }
}
