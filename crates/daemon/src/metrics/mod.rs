//! Counters of the daemon, and their text form for Prometheus.

mod register;

use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use lodestream_protocol::message::CloseCode;
use lodestream_protocol::source::CacheUse;
use lodestream_scene::{BlobId, BlobPart, PunctualLightBlob, TerrainBlob};
use prometheus::{Histogram, IntCounter, IntGauge, Registry, TextEncoder};
use tracing_appender::non_blocking::ErrorCounter;

use crate::admission::refusal::Refusal;

/// How a session travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Transport {
    /// QUIC.
    Quic,
    /// WebSocket.
    WebSocket,
}

impl Transport {
    const ALL: [Self; 2] = [Self::Quic, Self::WebSocket];

    /// Name in logs and metrics.
    #[must_use]
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Quic => "quic",
            Self::WebSocket => "ws",
        }
    }
}

/// Limits in bits per second, and what is given_bits_per_s of those that sessions share.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Rates {
    /// Of each session.
    pub(crate) per_session_bits_per_s: Option<u64>,
    /// Of the sessions of an address together.
    pub(crate) per_address_bits_per_s: Option<u64>,
    /// Of all sessions together.
    pub(crate) total_bits_per_s: Option<u64>,
    /// What sessions that have something to send are given_bits_per_s together; 0 where they share nothing.
    pub(crate) given_bits_per_s: u64,
}

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
        | BlobId::Terrain(TerrainBlob::Points(_))
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
    pub(crate) fn watch_log(&self, dropped: ErrorCounter) {
        // A second log would be a second process's.
        let _ = self.log.set(dropped);
    }

    /// All counters in Prometheus' text format (version 0.0.4).
    #[must_use]
    pub(crate) fn render(&self, rates: Rates, draining: bool, cache: Option<CacheUse>) -> String {
        // Who counts elsewhere is caught up with by one at a time.
        let _one = self.rendering.lock().unwrap_or_else(PoisonError::into_inner);
        let cache = cache.unwrap_or_default();
        self.cache_hits.inc_by(cache.hits.saturating_sub(self.cache_hits.get()));
        self.cache_misses.inc_by(cache.misses.saturating_sub(self.cache_misses.get()));
        let Rates { per_session_bits_per_s, per_address_bits_per_s, total_bits_per_s, given_bits_per_s } =
            rates;
        for (gauge, rate) in [
            (&self.rate, per_session_bits_per_s),
            (&self.address_rate, per_address_bits_per_s),
            (&self.total_rate, total_bits_per_s),
            (&self.given_rate, Some(given_bits_per_s)),
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
