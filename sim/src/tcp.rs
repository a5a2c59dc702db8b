//! One direction of a TCP connection over a link without loss: when does each byte arrive?
//!
//! Modelled: segments of at most [`SEGMENT_BYTES`] with their headers; slow start from ten segments
//! (RFC 6928, RFC 5681 §3.1) without delayed acknowledgements; a congestion window that stops
//! growing at the bandwidth–delay product plus the queue, as if the sender knew them, so the queue
//! never overflows; a receive window; acknowledgements that come back after the reverse delay and
//! take no bandwidth.
//!
//! Not modelled: loss and its recovery (a link with loss is refused), congestion avoidance, delayed
//! acknowledgements, Nagle's algorithm (taken as switched off), a send buffer larger than the
//! congestion window, window scaling, slow start after idle. Where a real sender overshoots the
//! queue and recovers, this one is faster.

use std::collections::VecDeque;

use bytes::Bytes;

use crate::link::{Fate, Link, LinkCounters, LinkSettings, NS_PER_S};

/// Payload of a full segment: Ethernet's 1500 bytes less the headers.
pub const SEGMENT_BYTES: usize = 1448;

/// Headers of a segment: IPv4, TCP, timestamps.
pub const IP_TCP_BYTES: u32 = 20 + 20 + 12;

/// Segments that a sender may send before it hears anything (RFC 6928).
const INITIAL_WINDOW_SEGMENTS: u64 = 10;

/// Bytes that may be on the way or wait to be read.
const RECEIVE_WINDOW_BYTES: u64 = 1 << 20;

/// Loss asked of a TCP link.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("loss {loss} over TCP: loss recovery is not modelled yet, so the loss must be 0")]
pub struct LossUnsupported {
    /// The probability asked for.
    pub loss: f64,
}

/// One direction of a TCP connection.
#[derive(Debug)]
pub struct TcpDirection {
    link: Link,
    /// Delay of the way back, for acknowledgements.
    reverse_delay_ns: u64,
    congestion_window_bytes: u64,
    largest_window_bytes: u64,
    /// Bytes sent and not yet acknowledged: when the acknowledgement arrives, how many.
    unacknowledged: VecDeque<(u64, u64)>,
    flight_bytes: u64,
    /// Sent and not yet read: arrival time, data.
    arriving: VecDeque<(u64, Bytes)>,
    unread_bytes: u64,
    /// When the end of the stream arrives, once it was sent.
    end_ns: Option<u64>,
}

impl TcpDirection {
    /// An idle direction.
    ///
    /// # Errors
    /// Refuses a link with loss.
    pub fn new(settings: LinkSettings, reverse_delay_ns: u64) -> Result<Self, LossUnsupported> {
        if settings.loss != 0.0 {
            return Err(LossUnsupported { loss: settings.loss });
        }
        let round_trip_ns = u128::from(settings.delay_ns) + u128::from(reverse_delay_ns);
        let product_bytes =
            u128::from(settings.rate_bits_per_s.get()) * round_trip_ns / (8 * u128::from(NS_PER_S));
        let segment = SEGMENT_BYTES as u64;
        let largest = u64::try_from(product_bytes)
            .unwrap_or(u64::MAX)
            .saturating_add(settings.queue_bytes)
            .clamp(2 * segment, RECEIVE_WINDOW_BYTES);
        Ok(Self {
            link: Link::new(settings, 0),
            reverse_delay_ns,
            congestion_window_bytes: (INITIAL_WINDOW_SEGMENTS * segment).min(largest),
            largest_window_bytes: largest,
            unacknowledged: VecDeque::new(),
            flight_bytes: 0,
            arriving: VecDeque::new(),
            unread_bytes: 0,
            end_ns: None,
        })
    }

    /// What the link has done.
    #[must_use]
    pub fn counters(&self) -> LinkCounters {
        self.link.counters()
    }

    /// Sends a packet without payload, as in a handshake; returns when it arrives.
    pub fn send_bare(&mut self, now_ns: u64) -> u64 {
        match self.link.offer(now_ns, 0) {
            Fate::Arrives { at_ns } => at_ns,
            // The window keeps the queue from filling, and there is no loss.
            Fate::Lost | Fate::QueueFull | Fate::TooBig => now_ns,
        }
    }

    /// Sends as much of `data` as the windows allow; returns how many bytes. With 0 the caller tries
    /// again at [`TcpDirection::next_acknowledgement_ns`], or once data has been read.
    pub fn send(&mut self, now_ns: u64, data: &[u8]) -> usize {
        self.take_acknowledgements(now_ns);
        let mut sent = 0;
        while sent < data.len() {
            let length = (data.len() - sent).min(SEGMENT_BYTES);
            let bytes = length as u64;
            let wire_bytes = bytes + u64::from(self.link.settings().overhead_bytes);
            let backlog = self.link.backlog_bytes(now_ns);
            if self.flight_bytes + bytes > self.congestion_window_bytes
                || self.unread_bytes + bytes > RECEIVE_WINDOW_BYTES
                || (backlog > 0 && backlog + wire_bytes > self.link.settings().queue_bytes)
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

    /// Ends the stream after what was sent.
    pub fn finish(&mut self, now_ns: u64) {
        if self.end_ns.is_none() {
            let last = self.arriving.back().map_or(0, |&(at_ns, _)| at_ns);
            self.end_ns = Some(self.send_bare(now_ns).max(last));
        }
    }

    /// When the next acknowledgement reaches the sender.
    #[must_use]
    pub fn next_acknowledgement_ns(&self) -> Option<u64> {
        self.unacknowledged.front().map(|&(at_ns, _)| at_ns)
    }

    /// Moves what has arrived by `now_ns` into `buffer`; returns how many bytes.
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

    /// When the next byte, or the end of the stream, reaches the receiver.
    #[must_use]
    pub fn next_arrival_ns(&self) -> Option<u64> {
        self.arriving.front().map(|&(at_ns, _)| at_ns).or(self.end_ns)
    }

    /// Whether the receiver has read everything and knows that nothing follows.
    #[must_use]
    pub fn is_finished(&self, now_ns: u64) -> bool {
        self.arriving.is_empty() && self.end_ns.is_some_and(|end_ns| end_ns <= now_ns)
    }

    /// Slow start: each acknowledged byte lets one more byte be on its way.
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
    use std::num::NonZeroU64;

    const MS: u64 = 1_000_000;

    fn settings(rate: u64) -> LinkSettings {
        LinkSettings {
            rate_bits_per_s: NonZeroU64::new(rate).unwrap(),
            delay_ns: 25 * MS,
            queue_bytes: 64 * 1024,
            loss: 0.0,
            overhead_bytes: IP_TCP_BYTES,
        }
    }

    /// Sends `bytes` as fast as the windows allow and reads at once; returns when the last arrives.
    fn last_arrival_ns(rate: u64, bytes: usize) -> u64 {
        let mut tcp = TcpDirection::new(settings(rate), 25 * MS).unwrap();
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
            let next = [tcp.next_acknowledgement_ns(), tcp.next_arrival_ns()];
            now_ns = next.into_iter().flatten().filter(|&t| t >= now_ns).min().unwrap().max(now_ns);
            if tcp.next_acknowledgement_ns() == Some(now_ns) {
                tcp.take_acknowledgements(now_ns);
            }
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
    fn windows_limit_what_is_on_its_way() {
        let mut tcp = TcpDirection::new(settings(2_000_000), 25 * MS).unwrap();
        let data = vec![0; 1 << 20];
        assert_eq!(tcp.send(0, &data), 10 * SEGMENT_BYTES);
        assert_eq!(tcp.send(0, &data), 0);
        // The first acknowledgement comes after 6 ms and a round trip, and lets two segments out.
        assert_eq!(tcp.next_acknowledgement_ns(), Some(56 * MS));
        assert_eq!(tcp.send(56 * MS, &data), 2 * SEGMENT_BYTES);
        let mut buffer = vec![0; 1 << 20];
        assert_eq!(tcp.receive(31 * MS - 1, &mut buffer), 0);
        assert_eq!(tcp.receive(31 * MS, &mut buffer), SEGMENT_BYTES);
    }

    #[test]
    fn an_unread_stream_stops() {
        let mut tcp = TcpDirection::new(settings(1_000_000_000), 25 * MS).unwrap();
        let data = vec![0; 4096];
        let mut sent = 0;
        for step in 0..100_000u64 {
            sent += tcp.send(step * MS, &data);
        }
        assert!(sent as u64 <= RECEIVE_WINDOW_BYTES && sent as u64 > RECEIVE_WINDOW_BYTES - 4096, "{sent}");
    }

    #[test]
    fn the_end_comes_after_the_last_byte() {
        let mut tcp = TcpDirection::new(settings(2_000_000), 25 * MS).unwrap();
        assert_eq!(tcp.send(0, b"abc"), 3);
        tcp.finish(0);
        let mut buffer = [0; 8];
        assert!(!tcp.is_finished(100 * MS));
        assert_eq!(tcp.receive(100 * MS, &mut buffer), 3);
        assert!(tcp.is_finished(100 * MS));
    }

    #[test]
    fn loss_is_refused() {
        let lossy = LinkSettings { loss: 0.01, ..settings(2_000_000) };
        let error = TcpDirection::new(lossy, 0).unwrap_err();
        assert!(error.to_string().contains("not modelled"), "{error}");
    }
}
