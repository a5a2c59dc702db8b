//! The names, help texts and buckets of all metrics.

use std::sync::{Mutex, OnceLock};

use lodestream_protocol::message::CloseCode;
use prometheus::{
    Histogram, HistogramOpts, IntCounter, IntCounterVec, IntGauge, IntGaugeVec, Opts, Registry,
};

use crate::limits::refusal::Refusal;
use crate::metrics::{Metrics, Transport};

/// Values of the label `kind`.
const KINDS: [&str; 5] = ["control", "base", "index", "chunk", "texture"];

/// Upper bounds of the buckets of `lodestream_bases_sent_seconds`.
const BASES_SENT_S: [f64; 10] = [0.01, 0.025, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4];

/// Upper bounds of the buckets of `lodestream_first_byte_seconds`: from a blob in memory to one in a remote store.
const FIRST_BYTE_S: [f64; 10] = [0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1.0, 4.0];

impl Metrics {
    /// Metrics whose families are registered in `registry`.
    pub(super) fn new(registry: Registry) -> prometheus::Result<Self> {
        let transports = Transport::ALL.map(Transport::name);
        let codes = CloseCode::ALL.map(|code| format!("{code:?}"));
        let codes = codes.each_ref().map(String::as_str);
        let sessions = IntGaugeVec::new(Opts::new("lodestream_sessions", "Open sessions."), &["transport"])?;
        registry.register(Box::new(sessions.clone()))?;
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
            "Payload handed to the transports, with frame headers.",
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
            "Sessions refused, by reason: limits of the server or the address, shutdown, token, origin, scene.",
            "reason",
        )?;
        let bases_sent = histogram(
            "lodestream_bases_sent_seconds",
            "Time from the start of a session until all visible base meshes were sent.",
            &BASES_SENT_S,
        )?;
        let first_byte = histogram(
            "lodestream_first_byte_seconds",
            "Time from the start of a session, or from a later Hello, until the first byte of a blob was sent.",
            &FIRST_BYTE_S,
        )?;
        Ok(Self {
            sessions: transports.map(|name| sessions.with_label_values(&[name])),
            started: transports.map(|name| started.with_label_values(&[name])),
            ended: codes.map(|name| ended.with_label_values(&[name])),
            refused: Refusal::ALL.map(|why| refused.with_label_values(&[why.name()])),
            bytes: KINDS.map(|name| bytes.with_label_values(&[name])),
            blobs: KINDS.map(|name| blobs.with_label_values(&[name])),
            rejected_messages: counter(
                "lodestream_rejected_messages_total",
                "Client messages that were rejected.",
            )?,
            refused_requests: counter(
                "lodestream_refused_requests_total",
                "Requests for blobs that were refused: no such blob, or the queue was full.",
            )?,
            unreadable_blobs: counter(
                "lodestream_unreadable_blobs_total",
                "Failed reads of blobs: packs damaged or deleted since the server started.",
            )?,
            http_requests: counter("lodestream_http_requests_total", "HTTP requests.")?,
            http_errors: counter(
                "lodestream_http_errors_total",
                "HTTP connections without a valid request.",
            )?,
            failed_handshakes: counter("lodestream_failed_handshakes_total", "QUIC handshakes that failed.")?,
            web_transport: counter(
                "lodestream_webtransport_sessions_total",
                "QUIC sessions that came by WebTransport.",
            )?,
            early_data: counter(
                "lodestream_early_data_sessions_total",
                "Resumed QUIC sessions whose client sent 0-RTT data.",
            )?,
            access_unavailable: counter(
                "lodestream_access_unknown_total",
                "Tokens about which the access program or URL gave no valid response in time.",
            )?,
            tokens_refused: counter(
                "lodestream_tokens_refused_total",
                "Sessions refused or ended because of their token: missing, invalid, expired or for another scene.",
            )?,
            certificate_not_after: gauge(
                "lodestream_certificate_not_after_seconds",
                "Expiry of the certificate of new connections, in seconds since 1970; 0 if unknown.",
            )?,
            certificates_refused: counter(
                "lodestream_certificates_refused_total",
                "Changes of the certificate files that could not be used.",
            )?,
            scene_changes: counter(
                "lodestream_scene_exchanges_total",
                "Scenes added, removed or replaced while the server ran.",
            )?,
            bases_sent,
            first_byte,
            turns: counter("lodestream_session_turns_total", "Turns of the loops of sessions.")?,
            timer_turns: counter(
                "lodestream_session_timers_total",
                "Turns of the loops of sessions that were caused by timers.",
            )?,
            queued: gauge("lodestream_queued_bytes", "Bytes of blobs and messages queued in sessions.")?,
            cache_hits: counter("lodestream_cache_hits_total", "Blobs found in memory.")?,
            cache_misses: counter("lodestream_cache_misses_total", "Blobs read from the store.")?,
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
            assigned_rate: gauge(
                "lodestream_given_rate_bits_per_second",
                "Rate of the shared limits that is assigned to sessions with queued data and usable by them.",
            )?,
            draining: gauge("lodestream_draining", "1 while the server shuts down.")?,
            dropped_log_lines: gauge(
                "lodestream_dropped_log_lines",
                "Log lines dropped because the reader of the log was too slow.",
            )?,
            log: OnceLock::new(),
            registry,
        })
    }
}
