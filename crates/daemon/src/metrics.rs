//! Counters of the daemon, and their text form for Prometheus.

use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use lodestream_protocol::message::CloseCode;
use lodestream_protocol::source::CacheUse;
use lodestream_scene::{BlobId, BlobPart, PunctualLightBlob, TerrainBlob};
use prometheus::{
    Histogram, HistogramOpts, IntCounter, IntCounterVec, IntGauge, IntGaugeVec, Opts, Registry, TextEncoder,
};
use tracing_appender::non_blocking::ErrorCounter;

use crate::admission::refusal::Refusal;

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

/// Limits in bits per second, and what is given of those that sessions share.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rates {
    /// Of each session.
    pub of_session: Option<u64>,
    /// Of the sessions of an address together.
    pub of_address: Option<u64>,
    /// Of all sessions together.
    pub of_all: Option<u64>,
    /// What sessions that have something to send are given together; 0 where they share nothing.
    pub given: u64,
}

/// Kinds of bytes that are counted apart.
const KINDS: [&str; 5] = ["control", "base", "index", "chunk", "texture"];

/// Upper ends of the histogram of times until all visible base meshes were handed over, in seconds.
const BASES_SENT_S: [f64; 10] = [0.01, 0.025, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4];

/// Upper ends of the histogram of times until the first byte of a blob was handed over, in seconds: from a blob in memory
/// to one in a store that is far away.
const FIRST_BYTE_S: [f64; 10] = [0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1.0, 4.0];

/// The daemon's counters, those of one server apart from another's in the same process.
#[derive(Debug)]
pub struct Metrics {
    registry: Registry,
    active: [IntGauge; 2],
    started: [IntCounter; 2],
    ended: [IntCounter; CloseCode::ALL.len()],
    refused: [IntCounter; Refusal::ALL.len()],
    bytes: [IntCounter; 5],
    blobs: [IntCounter; 5],
    rejected_messages: IntCounter,
    refused_requests: IntCounter,
    unreadable: IntCounter,
    http_requests: IntCounter,
    http_errors: IntCounter,
    failed_handshakes: IntCounter,
    early_data: IntCounter,
    tokens_refused: IntCounter,
    access_unknown: IntCounter,
    certificate_end: IntGauge,
    certificates_refused: IntCounter,
    scene_exchanges: IntCounter,
    bases_sent: Histogram,
    first_byte: Histogram,
    waiting: IntGauge,
    turns: IntCounter,
    alarms: IntCounter,
    cache_hits: IntCounter,
    cache_misses: IntCounter,
    rendering: Mutex<()>,
    rate: IntGauge,
    address_rate: IntGauge,
    total_rate: IntGauge,
    given_rate: IntGauge,
    draining: IntGauge,
    dropped_log_lines: IntGauge,
    log: OnceLock<ErrorCounter>,
}

/// Directories of terrain and punctual lights count as index, a terrain's points and pages of punctual lights as chunks.
const fn kind(id: &BlobId) -> usize {
    match id {
        BlobId::Asset { part: BlobPart::Base, .. } => 1,
        BlobId::Asset { part: BlobPart::IndexPage(_), .. }
        | BlobId::Terrain(TerrainBlob::DirectoryPage(_))
        | BlobId::PunctualLights(PunctualLightBlob::DirectoryPage(_)) => 2,
        BlobId::Asset { part: BlobPart::Chunk(_), .. }
        | BlobId::Terrain(TerrainBlob::HeightOverrides(_))
        | BlobId::PunctualLights(PunctualLightBlob::Page(_)) => 3,
        BlobId::Asset { part: BlobPart::Texture { .. }, .. } => 4,
    }
}

impl Default for Metrics {
    fn default() -> Self {
        Self::new(Registry::new()).expect("names of metrics are sound and no two alike: a test makes them")
    }
}

impl Metrics {
    fn new(registry: Registry) -> prometheus::Result<Self> {
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

    pub(crate) fn session_started(&self, transport: Transport) {
        self.active[transport as usize].inc();
        self.started[transport as usize].inc();
    }

    pub(crate) fn session_ended(&self, transport: Transport, code: CloseCode) {
        self.active[transport as usize].dec();
        self.ended[usize::from(code.number())].inc();
    }

    pub(crate) fn session_refused(&self, why: Refusal) {
        self.refused[why as usize].inc();
    }

    pub(crate) fn control_sent(&self, bytes: usize) {
        self.bytes[0].inc_by(bytes as u64);
        self.blobs[0].inc();
    }

    pub(crate) fn piece_sent(&self, id: &BlobId, bytes: usize, last: bool) {
        self.bytes[kind(id)].inc_by(bytes as u64);
        self.blobs[kind(id)].inc_by(u64::from(last));
    }

    pub(crate) fn message_rejected(&self) {
        self.rejected_messages.inc();
    }

    pub(crate) fn requests_refused(&self, count: usize) {
        self.refused_requests.inc_by(count as u64);
    }

    pub(crate) fn blob_unreadable(&self) {
        self.unreadable.inc();
    }

    pub(crate) fn http_request(&self) {
        self.http_requests.inc();
    }

    pub(crate) fn http_error(&self) {
        self.http_errors.inc();
    }

    pub(crate) fn handshake_failed(&self) {
        self.failed_handshakes.inc();
    }

    /// Nothing could be found out about a token.
    pub(crate) fn access_unknown(&self) {
        self.access_unknown.inc();
    }

    pub(crate) fn token_refused(&self) {
        self.tokens_refused.inc();
    }

    pub(crate) fn certificate_in_use(&self, not_after: Option<SystemTime>) {
        let since_1970 = not_after.and_then(|end| end.duration_since(UNIX_EPOCH).ok());
        let seconds = since_1970.map_or(0, |duration| duration.as_secs());
        self.certificate_end.set(i64::try_from(seconds).unwrap_or(i64::MAX));
    }

    pub(crate) fn certificate_refused(&self) {
        self.certificates_refused.inc();
    }

    pub(crate) fn scenes_exchanged(&self, count: usize) {
        self.scene_exchanges.inc_by(count as u64);
    }

    pub(crate) fn early_data(&self) {
        self.early_data.inc();
    }

    pub(crate) fn bases_sent(&self, after: Duration) {
        self.bases_sent.observe(after.as_secs_f64());
    }

    pub(crate) fn first_byte(&self, after: Duration) {
        self.first_byte.observe(after.as_secs_f64());
    }

    /// A session's loop has turned so often, and so often because a timer had run out.
    pub(crate) fn turned(&self, turns: u32, alarms: u32) {
        self.turns.inc_by(turns.into());
        self.alarms.inc_by(alarms.into());
    }

    /// What waits in a session has changed.
    pub(crate) fn waiting_changed(&self, from_bytes: u64, to_bytes: u64) {
        let signed = |bytes: u64| i64::try_from(bytes).unwrap_or(i64::MAX);
        self.waiting.add(signed(to_bytes) - signed(from_bytes));
    }

    /// Bytes of blobs and messages that wait in sessions.
    #[must_use]
    pub fn waiting_bytes(&self) -> u64 {
        u64::try_from(self.waiting.get()).unwrap_or(0)
    }

    /// Sessions that are open now.
    #[must_use]
    pub fn active_sessions(&self) -> u64 {
        self.active.iter().map(|gauge| u64::try_from(gauge.get()).unwrap_or(0)).sum()
    }

    /// Resumed QUIC sessions whose first words came before the handshake was complete (0-RTT).
    #[must_use]
    pub fn early_data_sessions(&self) -> u64 {
        self.early_data.get()
    }

    /// Messages of clients that were refused.
    #[must_use]
    pub fn rejected_messages(&self) -> u64 {
        self.rejected_messages.get()
    }

    /// Bytes handed to the transports, frames' heads included.
    #[must_use]
    pub fn bytes_sent(&self) -> u64 {
        self.bytes.iter().map(IntCounter::get).sum()
    }

    /// Tells how the log's lines that are left out are counted, once.
    pub fn watch_log(&self, dropped: ErrorCounter) {
        // A second log would be a second process's.
        let _ = self.log.set(dropped);
    }

    /// All counters in Prometheus' text format (version 0.0.4).
    #[must_use]
    pub fn render(&self, rates: Rates, draining: bool, cache: Option<CacheUse>) -> String {
        // Who counts elsewhere is caught up with by one at a time.
        let _one = self.rendering.lock().unwrap_or_else(PoisonError::into_inner);
        let cache = cache.unwrap_or_default();
        self.cache_hits.inc_by(cache.hits.saturating_sub(self.cache_hits.get()));
        self.cache_misses.inc_by(cache.misses.saturating_sub(self.cache_misses.get()));
        let Rates { of_session, of_address, of_all, given } = rates;
        for (gauge, rate) in [
            (&self.rate, of_session),
            (&self.address_rate, of_address),
            (&self.total_rate, of_all),
            (&self.given_rate, Some(given)),
        ] {
            gauge.set(i64::try_from(rate.unwrap_or(0)).unwrap_or(i64::MAX));
        }
        self.draining.set(i64::from(draining));
        let dropped = self.log.get().map_or(0, ErrorCounter::dropped_lines);
        self.dropped_log_lines.set(i64::try_from(dropped).unwrap_or(i64::MAX));
        let mut text = String::with_capacity(4096);
        // Fails for a family without metrics, and there is none.
        let _ = TextEncoder::new().encode_utf8(&self.registry.gather(), &mut text);
        text
    }
}
