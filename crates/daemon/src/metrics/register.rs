//! The names, help texts and buckets of all metrics.

use std::sync::{Mutex, OnceLock};

use lodestream_protocol::message::CloseCode;
use prometheus::{
    Histogram, HistogramOpts, IntCounter, IntCounterVec, IntGauge, IntGaugeVec, Opts, Registry,
};

use crate::admission::refusal::Refusal;
use crate::metrics::{Metrics, Transport};

/// Kinds of bytes that are counted apart.
const KINDS: [&str; 5] = ["control", "base", "index", "chunk", "texture"];

/// Upper ends of the histogram of times until all visible base meshes were handed over, in seconds.
const BASES_SENT_S: [f64; 10] = [0.01, 0.025, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4];

/// Upper ends of the histogram of times until the first byte of a blob was handed over, in seconds: from a blob in memory
/// to one in a store that is far away.
const FIRST_BYTE_S: [f64; 10] = [0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1.0, 4.0];

impl Metrics {
    /// Metrics whose families are registered in `registry`.
    pub(super) fn new(registry: Registry) -> prometheus::Result<Self> {
        let transports = Transport::ALL.map(Transport::name);
        let codes = CloseCode::ALL.map(|code| format!("{code:?}"));
        let codes = codes.each_ref().map(String::as_str);
        let active = IntGaugeVec::new(Opts::new("lodestream_sessions", "Open sessions."), &["transport"])?;
        registry.register(Box::new(active.clone()))?;
        let counters = |name: &str, help: &str, label: &str| -> prometheus::Result<IntCounterVec> {
            let counters = IntCounterVec::new(Opts::new(name, help), &[label])?;
            registry.register(Box::new(counters.clone()))?;
            Ok(counters)
        };
        let counter = |name: &str, help: &str| -> prometheus::Result<IntCounter> {
            let counter = IntCounter::new(name, help)?;
            registry.register(Box::new(counter.clone()))?;
            Ok(counter)
        };
        let gauge = |name: &str, help: &str| -> prometheus::Result<IntGauge> {
            let gauge = IntGauge::new(name, help)?;
            registry.register(Box::new(gauge.clone()))?;
            Ok(gauge)
        };
        let started = counters("lodestream_sessions_total", "Sessions opened.", "transport")?;
        let ended = counters("lodestream_sessions_ended_total", "Sessions ended, by reason.", "reason")?;
        let bytes = counters(
            "lodestream_sent_bytes_total",
            "Payload handed to the transports, with frames' heads.",
            "kind",
        )?;
        let blobs =
            counters("lodestream_sent_total", "Messages and whole blobs handed to the transports.", "kind")?;
        let histogram = |name: &str, help: &str, buckets: &[f64]| -> prometheus::Result<Histogram> {
            let histogram = Histogram::with_opts(HistogramOpts::new(name, help).buckets(buckets.to_vec()))?;
            registry.register(Box::new(histogram.clone()))?;
            Ok(histogram)
        };
        let refused = counters(
            "lodestream_sessions_refused_total",
            "Sessions refused, by reason: the server or the address has no place, it drains, the token, the origin.",
            "reason",
        )?;
        let bases_sent = histogram(
            "lodestream_bases_sent_seconds",
            "From the start of a session until all visible base meshes were handed over.",
            &BASES_SENT_S,
        )?;
        let first_byte = histogram(
            "lodestream_first_byte_seconds",
            "From the start of a session, or from its Hello if that was later, until the first byte of a blob was handed over.",
            &FIRST_BYTE_S,
        )?;
        Ok(Self {
            active: transports.map(|name| active.with_label_values(&[name])),
            started: transports.map(|name| started.with_label_values(&[name])),
            ended: codes.map(|name| ended.with_label_values(&[name])),
            refused: Refusal::ALL.map(|why| refused.with_label_values(&[why.name()])),
            bytes: KINDS.map(|name| bytes.with_label_values(&[name])),
            blobs: KINDS.map(|name| blobs.with_label_values(&[name])),
            rejected_messages: counter(
                "lodestream_rejected_messages_total",
                "Messages of clients that were refused.",
            )?,
            refused_requests: counter(
                "lodestream_refused_requests_total",
                "Requests for blobs that were refused: there are none such, or too many were queued.",
            )?,
            unreadable: counter(
                "lodestream_unreadable_blobs_total",
                "Reads of blobs that failed: packs damaged or gone since the server started.",
            )?,
            http_requests: counter("lodestream_http_requests_total", "HTTP requests.")?,
            http_errors: counter(
                "lodestream_http_errors_total",
                "HTTP connections that sent no proper request.",
            )?,
            failed_handshakes: counter("lodestream_failed_handshakes_total", "QUIC handshakes that failed.")?,
            early_data: counter(
                "lodestream_early_data_sessions_total",
                "Resumed QUIC sessions whose first words came before the handshake was complete.",
            )?,
            access_unknown: counter(
                "lodestream_access_unknown_total",
                "Tokens of which the program or URL that decides about them said nothing in time, or nonsense.",
            )?,
            tokens_refused: counter(
                "lodestream_tokens_refused_total",
                "Sessions refused or ended for their tokens: none, of another key, expired, for another scene.",
            )?,
            certificate_end: gauge(
                "lodestream_certificate_not_after_seconds",
                "When the certificate of new connections expires, in seconds since 1970; 0 where that is not known.",
            )?,
            certificates_refused: counter(
                "lodestream_certificates_refused_total",
                "Changes of the certificate's files that could not be used; the old one stayed.",
            )?,
            scene_exchanges: counter(
                "lodestream_scene_exchanges_total",
                "Scenes that came, went or were exchanged while the server ran.",
            )?,
            bases_sent,
            first_byte,
            turns: counter(
                "lodestream_session_turns_total",
                "Turns of the loops of sessions: how often one was woken, or went on without being.",
            )?,
            alarms: counter(
                "lodestream_session_timers_total",
                "Of these, those in which a timer had run out.",
            )?,
            waiting: gauge(
                "lodestream_queued_bytes",
                "Bytes of blobs and messages that wait in sessions to be handed to the transports.",
            )?,
            cache_hits: counter(
                "lodestream_cache_hits_total",
                "Blobs that were in memory when they were to be sent.",
            )?,
            cache_misses: counter(
                "lodestream_cache_misses_total",
                "Blobs that had to be read first when they were to be sent.",
            )?,
            rendering: Mutex::new(()),
            rate: gauge("lodestream_rate_bits_per_second", "Limit of each session; 0 for none.")?,
            address_rate: gauge(
                "lodestream_rate_per_address_bits_per_second",
                "Limit of the sessions of each address together; 0 for none.",
            )?,
            total_rate: gauge(
                "lodestream_total_rate_bits_per_second",
                "Limit of all sessions together; 0 for none.",
            )?,
            given_rate: gauge(
                "lodestream_given_rate_bits_per_second",
                "What sessions that have something to send are given now of the limits that they share, as far as they can use it.",
            )?,
            draining: gauge("lodestream_draining", "1 while the server shuts down.")?,
            dropped_log_lines: gauge(
                "lodestream_dropped_log_lines",
                "Log lines left out because whoever reads the log was too slow.",
            )?,
            log: OnceLock::new(),
            registry,
        })
    }
}
