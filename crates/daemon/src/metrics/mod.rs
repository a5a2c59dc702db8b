//! Counters of the daemon, and their text form for Prometheus.

mod register;

use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use lodestream_protocol::message::CloseCode;
use lodestream_protocol::source::CacheUse;
use lodestream_scene::{BlobId, BlobPart, PartBlob, PunctualLightBlob, TerrainBlob};
use prometheus::{Histogram, IntCounter, IntGauge, Registry, TextEncoder};
use tracing_appender::non_blocking::ErrorCounter;

use crate::limits::refusal::Refusal;

/// Transport of a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Transport {
    /// QUIC.
    Quic,
    /// WebSocket.
    WebSocket,
}

impl Transport {
    const ALL: [Self; 2] = [Self::Quic, Self::WebSocket];

    /// Name in logs and value of the label `transport`.
    #[must_use]
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Quic => "quic",
            Self::WebSocket => "ws",
        }
    }
}

/// Rate limits, and the part of the shared limits in use.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Rates {
    /// Limit of each session.
    pub(crate) per_session_bits_per_s: Option<u64>,
    /// Limit of all sessions of one address together.
    pub(crate) per_address_bits_per_s: Option<u64>,
    /// Limit of all sessions together.
    pub(crate) total_bits_per_s: Option<u64>,
    /// Rate assigned to sessions with queued data; 0 without shared limits.
    pub(crate) assigned_bits_per_s: u64,
}

/// The metrics of one daemon; several in one process are independent.
#[derive(Debug)]
pub struct Metrics {
    registry: Registry,
    sessions: [IntGauge; 2],
    started: [IntCounter; 2],
    ended: [IntCounter; CloseCode::ALL.len()],
    refused: [IntCounter; Refusal::ALL.len()],
    bytes: [IntCounter; 5],
    blobs: [IntCounter; 5],
    rejected_messages: IntCounter,
    refused_requests: IntCounter,
    unreadable_blobs: IntCounter,
    http_requests: IntCounter,
    http_errors: IntCounter,
    failed_handshakes: IntCounter,
    web_transport: IntCounter,
    early_data: IntCounter,
    tokens_refused: IntCounter,
    access_unavailable: IntCounter,
    certificate_not_after: IntGauge,
    certificates_refused: IntCounter,
    scene_changes: IntCounter,
    bases_sent: Histogram,
    first_byte: Histogram,
    queued: IntGauge,
    turns: IntCounter,
    timer_turns: IntCounter,
    cache_hits: IntCounter,
    cache_misses: IntCounter,
    rendering: Mutex<()>,
    rate: IntGauge,
    address_rate: IntGauge,
    total_rate: IntGauge,
    assigned_rate: IntGauge,
    draining: IntGauge,
    dropped_log_lines: IntGauge,
    log: OnceLock<ErrorCounter>,
}

/// Index of a blob's kind in the label values. Directory pages of terrain, punctual lights and parts count as index pages,
/// height overrides, pages of punctual lights and parts, and animations as chunks.
const fn kind(id: &BlobId) -> usize {
    match id {
        BlobId::Asset { part: BlobPart::Base, .. } => 1,
        BlobId::Asset { part: BlobPart::IndexPage(_) | BlobPart::TextureRegions, .. }
        | BlobId::Terrain(TerrainBlob::DirectoryPage(_))
        | BlobId::PunctualLights(PunctualLightBlob::DirectoryPage(_))
        | BlobId::Parts(PartBlob::DirectoryPage(_)) => 2,
        BlobId::Asset { part: BlobPart::Chunk(_), .. }
        | BlobId::Terrain(TerrainBlob::HeightOverrides(_))
        | BlobId::PunctualLights(PunctualLightBlob::Page(_))
        | BlobId::Parts(PartBlob::Page(_))
        | BlobId::Animation(_) => 3,
        BlobId::Asset { part: BlobPart::Texture { .. } | BlobPart::Tile(_), .. } => 4,
    }
}

impl Default for Metrics {
    fn default() -> Self {
        Self::new(Registry::new()).expect("metric names are valid and unique, as a test checks")
    }
}

impl Metrics {
    pub(crate) fn session_started(&self, transport: Transport) {
        self.sessions[transport as usize].inc();
        self.started[transport as usize].inc();
    }

    pub(crate) fn session_ended(&self, transport: Transport, code: CloseCode) {
        self.sessions[transport as usize].dec();
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
        self.unreadable_blobs.inc();
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

    /// The operator's program or URL gave no usable response about a token.
    pub(crate) fn access_unavailable(&self) {
        self.access_unavailable.inc();
    }

    pub(crate) fn token_refused(&self) {
        self.tokens_refused.inc();
    }

    pub(crate) fn certificate_in_use(&self, not_after: Option<SystemTime>) {
        let since_1970 = not_after.and_then(|end| end.duration_since(UNIX_EPOCH).ok());
        let seconds = since_1970.map_or(0, |duration| duration.as_secs());
        self.certificate_not_after.set(i64::try_from(seconds).unwrap_or(i64::MAX));
    }

    pub(crate) fn certificate_refused(&self) {
        self.certificates_refused.inc();
    }

    pub(crate) fn scenes_changed(&self, count: usize) {
        self.scene_changes.inc_by(count as u64);
    }

    /// Counts a QUIC session that came by WebTransport.
    pub(crate) fn web_transport_session(&self) {
        self.web_transport.inc();
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

    /// Adds turns of a session's loop, and those of them caused by timers.
    pub(crate) fn loop_turns(&self, turns: u32, timer_turns: u32) {
        self.turns.inc_by(turns.into());
        self.timer_turns.inc_by(timer_turns.into());
    }

    /// Updates the queued bytes for a change in one session.
    pub(crate) fn queued_changed(&self, from_bytes: u64, to_bytes: u64) {
        let signed = |bytes: u64| i64::try_from(bytes).unwrap_or(i64::MAX);
        self.queued.add(signed(to_bytes) - signed(from_bytes));
    }

    /// Bytes of blobs and messages queued in sessions.
    #[must_use]
    pub fn waiting_bytes(&self) -> u64 {
        u64::try_from(self.queued.get()).unwrap_or(0)
    }

    /// Open sessions.
    #[must_use]
    pub fn active_sessions(&self) -> u64 {
        self.sessions.iter().map(|gauge| u64::try_from(gauge.get()).unwrap_or(0)).sum()
    }

    /// Resumed QUIC sessions whose client sent 0-RTT data.
    #[must_use]
    pub fn early_data_sessions(&self) -> u64 {
        self.early_data.get()
    }

    /// Client messages that were rejected.
    #[must_use]
    pub fn rejected_messages(&self) -> u64 {
        self.rejected_messages.get()
    }

    /// Bytes handed to the transports, with frame headers.
    #[must_use]
    pub fn bytes_sent(&self) -> u64 {
        self.bytes.iter().map(IntCounter::get).sum()
    }

    /// Sets the counter of dropped log lines, once.
    pub(crate) fn watch_log(&self, dropped: ErrorCounter) {
        // A process has one log.
        let _ = self.log.set(dropped);
    }

    /// All metrics in Prometheus' text format (version 0.0.4).
    #[must_use]
    pub(crate) fn render(&self, rates: Rates, draining: bool, cache: Option<CacheUse>) -> String {
        // One at a time: the cache counters are advanced to values that are counted elsewhere.
        let _guard = self.rendering.lock().unwrap_or_else(PoisonError::into_inner);
        let cache = cache.unwrap_or_default();
        self.cache_hits.inc_by(cache.hits.saturating_sub(self.cache_hits.get()));
        self.cache_misses.inc_by(cache.misses.saturating_sub(self.cache_misses.get()));
        let Rates { per_session_bits_per_s, per_address_bits_per_s, total_bits_per_s, assigned_bits_per_s } =
            rates;
        for (gauge, rate) in [
            (&self.rate, per_session_bits_per_s),
            (&self.address_rate, per_address_bits_per_s),
            (&self.total_rate, total_bits_per_s),
            (&self.assigned_rate, Some(assigned_bits_per_s)),
        ] {
            gauge.set(i64::try_from(rate.unwrap_or(0)).unwrap_or(i64::MAX));
        }
        self.draining.set(i64::from(draining));
        let dropped = self.log.get().map_or(0, ErrorCounter::dropped_lines);
        self.dropped_log_lines.set(i64::try_from(dropped).unwrap_or(i64::MAX));
        let mut text = String::with_capacity(4096);
        // Fails only for a family without metrics.
        let _ = TextEncoder::new().encode_utf8(&self.registry.gather(), &mut text);
        text
    }
}
