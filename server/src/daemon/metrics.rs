//! Counters of the daemon, and their text form for Prometheus.

use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use lodestream_protocol::message::CloseCode;
use lodestream_protocol::{BlobId, BlobPart, TerrainBlob};

/// How a session travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// QUIC.
    Quic,
    /// WebSocket.
    WebSocket,
}

impl Transport {
    const ALL: [Self; 2] = [Self::Quic, Self::WebSocket];

    /// Name in logs and metrics.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Quic => "quic",
            Self::WebSocket => "ws",
        }
    }
}

/// Kinds of bytes that are counted apart.
const KINDS: [&str; 5] = ["control", "base", "index", "chunk", "texture"];

/// Upper ends of the histogram of times until all visible base meshes were handed over, in ms.
const BASES_SENT_MS: [u64; 10] = [10, 25, 50, 100, 200, 400, 800, 1600, 3200, 6400];

/// The daemon's counters.
#[derive(Debug, Default)]
pub struct Metrics {
    active: [AtomicU64; 2],
    started: [AtomicU64; 2],
    ended: [AtomicU64; CloseCode::ALL.len()],
    refused: AtomicU64,
    bytes: [AtomicU64; 5],
    blobs: [AtomicU64; 5],
    rejected_messages: AtomicU64,
    http_requests: AtomicU64,
    http_errors: AtomicU64,
    failed_handshakes: AtomicU64,
    early_data: AtomicU64,
    bases_sent: [AtomicU64; BASES_SENT_MS.len() + 1],
    bases_sent_sum_us: AtomicU64,
}

/// A terrain's directory counts as index, its points as chunks.
const fn kind(id: &BlobId) -> usize {
    match id {
        BlobId::Asset { part: BlobPart::Base, .. } => 1,
        BlobId::Asset { part: BlobPart::IndexPage(_), .. }
        | BlobId::Terrain(TerrainBlob::DirectoryPage(_)) => 2,
        BlobId::Asset { part: BlobPart::Chunk(_), .. } | BlobId::Terrain(TerrainBlob::Points(_)) => 3,
        BlobId::Asset { part: BlobPart::Texture { .. }, .. } => 4,
    }
}

fn add(counter: &AtomicU64, n: u64) {
    counter.fetch_add(n, Ordering::Relaxed);
}

fn get(counter: &AtomicU64) -> u64 {
    counter.load(Ordering::Relaxed)
}

impl Metrics {
    pub(super) fn session_started(&self, transport: Transport) {
        add(&self.active[transport as usize], 1);
        add(&self.started[transport as usize], 1);
    }

    pub(super) fn session_ended(&self, transport: Transport, code: CloseCode) {
        self.active[transport as usize].fetch_sub(1, Ordering::Relaxed);
        add(&self.ended[usize::from(code.number())], 1);
    }

    pub(super) fn session_refused(&self) {
        add(&self.refused, 1);
    }

    pub(super) fn control_sent(&self, bytes: usize) {
        add(&self.bytes[0], bytes as u64);
        add(&self.blobs[0], 1);
    }

    pub(super) fn piece_sent(&self, id: &BlobId, bytes: usize, last: bool) {
        add(&self.bytes[kind(id)], bytes as u64);
        add(&self.blobs[kind(id)], u64::from(last));
    }

    pub(super) fn message_rejected(&self) {
        add(&self.rejected_messages, 1);
    }

    pub(super) fn http_request(&self) {
        add(&self.http_requests, 1);
    }

    pub(super) fn http_error(&self) {
        add(&self.http_errors, 1);
    }

    pub(super) fn handshake_failed(&self) {
        add(&self.failed_handshakes, 1);
    }

    pub(super) fn early_data(&self) {
        add(&self.early_data, 1);
    }

    pub(super) fn bases_sent(&self, after: Duration) {
        let ms = u64::try_from(after.as_millis()).unwrap_or(u64::MAX);
        let bucket = BASES_SENT_MS.iter().position(|&end| ms <= end).unwrap_or(BASES_SENT_MS.len());
        add(&self.bases_sent[bucket], 1);
        add(&self.bases_sent_sum_us, u64::try_from(after.as_micros()).unwrap_or(u64::MAX));
    }

    /// Sessions that are open now.
    #[must_use]
    pub fn active_sessions(&self) -> u64 {
        self.active.iter().map(get).sum()
    }

    /// Resumed QUIC sessions whose first words came before the handshake was complete (0-RTT).
    #[must_use]
    pub fn early_data_sessions(&self) -> u64 {
        get(&self.early_data)
    }

    /// Messages of clients that were refused.
    #[must_use]
    pub fn rejected_messages(&self) -> u64 {
        get(&self.rejected_messages)
    }

    /// Bytes handed to the transports, frames' heads included.
    #[must_use]
    pub fn bytes_sent(&self) -> u64 {
        self.bytes.iter().map(get).sum()
    }

    /// All counters in Prometheus' text format (version 0.0.4).
    #[must_use]
    pub fn render(&self, rate_bits_per_s: Option<u64>, draining: bool) -> String {
        let mut out = Text(String::with_capacity(4096));
        out.head("lodestream_sessions", "gauge", "Open sessions.");
        for transport in Transport::ALL {
            out.labelled(
                "lodestream_sessions",
                "transport",
                transport.name(),
                get(&self.active[transport as usize]),
            );
        }
        out.head("lodestream_sessions_total", "counter", "Sessions opened.");
        for transport in Transport::ALL {
            let count = get(&self.started[transport as usize]);
            out.labelled("lodestream_sessions_total", "transport", transport.name(), count);
        }
        out.head("lodestream_sessions_ended_total", "counter", "Sessions ended, by reason.");
        for code in CloseCode::ALL {
            let count = get(&self.ended[usize::from(code.number())]);
            out.labelled("lodestream_sessions_ended_total", "reason", &format!("{code:?}"), count);
        }
        out.head(
            "lodestream_sent_bytes_total",
            "counter",
            "Payload handed to the transports, with frames' heads.",
        );
        for (name, bytes) in KINDS.iter().zip(&self.bytes) {
            out.labelled("lodestream_sent_bytes_total", "kind", name, get(bytes));
        }
        out.head("lodestream_sent_total", "counter", "Messages and whole blobs handed to the transports.");
        for (name, count) in KINDS.iter().zip(&self.blobs) {
            out.labelled("lodestream_sent_total", "kind", name, get(count));
        }
        out.head(
            "lodestream_bases_sent_seconds",
            "histogram",
            "From the start of a session until all visible base meshes were handed over.",
        );
        let mut below = 0;
        for (end_ms, count) in BASES_SENT_MS.iter().zip(&self.bases_sent) {
            below += get(count);
            let end = format!("{}.{:03}", end_ms / 1000, end_ms % 1000);
            out.labelled("lodestream_bases_sent_seconds_bucket", "le", &end, below);
        }
        below += get(&self.bases_sent[BASES_SENT_MS.len()]);
        out.labelled("lodestream_bases_sent_seconds_bucket", "le", "+Inf", below);
        let sum_us = get(&self.bases_sent_sum_us);
        let sum = format!("{}.{:06}", sum_us / 1_000_000, sum_us % 1_000_000);
        out.line(&format!("lodestream_bases_sent_seconds_sum {sum}"));
        out.line(&format!("lodestream_bases_sent_seconds_count {below}"));
        for (name, what, value) in [
            (
                "lodestream_rejected_messages_total",
                "Messages of clients that were refused.",
                get(&self.rejected_messages),
            ),
            (
                "lodestream_sessions_refused_total",
                "Sessions refused because the server was full or draining.",
                get(&self.refused),
            ),
            (
                "lodestream_failed_handshakes_total",
                "QUIC handshakes that failed.",
                get(&self.failed_handshakes),
            ),
            (
                "lodestream_early_data_sessions_total",
                "Resumed QUIC sessions whose first words came before the handshake was complete.",
                get(&self.early_data),
            ),
            ("lodestream_http_requests_total", "HTTP requests.", get(&self.http_requests)),
            (
                "lodestream_http_errors_total",
                "HTTP connections that sent no proper request.",
                get(&self.http_errors),
            ),
        ] {
            out.head(name, "counter", what);
            out.line(&format!("{name} {value}"));
        }
        for (name, what, value) in [
            (
                "lodestream_rate_bits_per_second",
                "Limit of each session; 0 for none.",
                rate_bits_per_s.unwrap_or(0),
            ),
            ("lodestream_draining", "1 while the server shuts down.", u64::from(draining)),
        ] {
            out.head(name, "gauge", what);
            out.line(&format!("{name} {value}"));
        }
        out.0
    }
}

/// Lines of the text format. Writing to a string cannot fail.
struct Text(String);

impl Text {
    fn line(&mut self, line: &str) {
        self.0.push_str(line);
        self.0.push('\n');
    }

    fn head(&mut self, name: &str, kind: &str, what: &str) {
        let _ = writeln!(self.0, "# HELP {name} {what}\n# TYPE {name} {kind}");
    }

    fn labelled(&mut self, name: &str, label: &str, value: &str, number: u64) {
        let _ = writeln!(self.0, "{name}{{{label}=\"{value}\"}} {number}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_show_up_in_the_text() {
        let metrics = Metrics::default();
        metrics.session_started(Transport::Quic);
        metrics.session_started(Transport::WebSocket);
        metrics.session_ended(Transport::WebSocket, CloseCode::Timeout);
        metrics.piece_sent(&BlobId::chunk(0, 3), 1000, false);
        metrics.piece_sent(&BlobId::chunk(0, 3), 500, true);
        metrics.bases_sent(Duration::from_millis(60));
        metrics.bases_sent(Duration::from_secs(60));
        let text = metrics.render(Some(2_000_000), false);
        for line in [
            "lodestream_sessions{transport=\"quic\"} 1",
            "lodestream_sessions{transport=\"ws\"} 0",
            "lodestream_sessions_total{transport=\"ws\"} 1",
            "lodestream_sessions_ended_total{reason=\"Timeout\"} 1",
            "lodestream_sent_bytes_total{kind=\"chunk\"} 1500",
            "lodestream_sent_total{kind=\"chunk\"} 1",
            "lodestream_bases_sent_seconds_bucket{le=\"0.050\"} 0",
            "lodestream_bases_sent_seconds_bucket{le=\"0.100\"} 1",
            "lodestream_bases_sent_seconds_bucket{le=\"+Inf\"} 2",
            "lodestream_bases_sent_seconds_sum 60.060000",
            "lodestream_bases_sent_seconds_count 2",
            "lodestream_rate_bits_per_second 2000000",
            "lodestream_draining 0",
        ] {
            assert!(text.lines().any(|l| l == line), "{line}\n{text}");
        }
        assert_eq!(metrics.active_sessions(), 1);
    }
}
