//! The result of a run, as text and JSON.

use std::collections::BTreeMap;

use serde::Serialize;

use super::ledger::Use;
use super::picture::{FirstSecondsError, Picture};
use super::plan::Transport;
use super::technique::Technique;
use super::timeline::Sample;

/// One run of a plan. Times count from the client's connect call, in milliseconds of virtual time; `None` if the time
/// limit came first. Bytes are transport payload received by the client, handshake included: payload of UDP datagrams,
/// or of TCP segments.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunResult {
    /// The scene's name in the plan.
    pub scene: String,
    /// The technique: "lodestream", or a baseline's name.
    pub technique: String,
    /// Transport between client and server.
    pub transport: Transport,
    /// Whether the connection was resumed with an earlier ticket. The cache was empty nevertheless.
    pub resumed: bool,
    /// The link's name or description.
    pub link: String,
    /// The camera path's name.
    pub camera: String,
    /// Rate of the link from server to client at the start. Loss and queue are of the same direction.
    pub rate_bits_per_s: u64,
    /// Round trip without queueing and jitter.
    pub rtt_ms: f64,
    /// Long-run share of packets lost at random.
    pub loss: f64,
    /// Queue length of the link.
    pub queue_bytes: u64,
    /// Rate limit of the session; `None` for none.
    pub limiter_bits_per_s: Option<u64>,
    /// Seed of the run.
    pub seed: u64,
    /// Time to first frame (TTFF): until the core could draw every visible instance.
    pub ttff_ms: Option<f64>,
    /// Bytes until then.
    pub first_frame_bytes: Option<u64>,
    /// Time to quality (TTQ), by screen error in pixels: until no visible part had a larger error.
    pub ttq_ms: BTreeMap<String, Option<f64>>,
    /// Bytes until then.
    pub ttq_bytes: BTreeMap<String, Option<u64>>,
    /// The same over parts that are not occluded by the scene's own surfaces, as the client knows them; `None` for
    /// baselines.
    pub unoccluded_ttq_ms: BTreeMap<String, Option<f64>>,
    /// Bytes until then.
    pub unoccluded_ttq_bytes: BTreeMap<String, Option<u64>>,
    /// Bytes until the selection was settled with the camera at rest, or the time limit.
    pub total_bytes: u64,
    /// Range requests until the end; `None` over sessions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub requests: Option<u64>,
    /// Time until then.
    pub settled_ms: Option<f64>,
    /// Why the run ended: "settled", "time limit", or why the connection was lost.
    pub ended: String,
    /// When both sides had closed the connection.
    pub ended_ms: Option<f64>,
    /// When a moving camera came to rest.
    pub rest_ms: Option<f64>,
    /// Time from then until no visible part had a larger screen error, by screen error in pixels; empty if the camera
    /// did not move, or did not come to rest.
    pub rest_ttq_ms: BTreeMap<String, Option<f64>>,
    /// The same over parts that are not occluded.
    pub rest_unoccluded_ttq_ms: BTreeMap<String, Option<f64>>,
    /// Pauses of half a second or more after the first frame, in which blobs were requested and no byte arrived.
    pub stalls: u32,
    /// Their total length.
    pub stalled_ms: f64,
    /// Number of distinct assets; `None` if the client never received the scene, and for baselines.
    pub assets: Option<u32>,
    /// Number of instances.
    pub instances: Option<u32>,
    /// Faces of the chunks applied at the end; `None` for baselines.
    pub applied_faces: Option<u64>,
    /// Payload bytes of the chunks that the view needed at the end; `None` for baselines.
    pub needed_bytes: Option<u64>,
    /// Of these, bytes of chunks needed only for shadows.
    pub shadow_bytes: Option<u64>,
    /// Use of the received chunk bytes.
    #[serde(flatten)]
    pub usage: Use,
    /// Packets from server to client lost at random.
    pub packets_lost: u64,
    /// Packets from server to client dropped at a full queue.
    pub packets_dropped: u64,
    /// The same from client to server.
    pub packets_lost_up: u64,
    /// The same from client to server.
    pub packets_dropped_up: u64,
    /// Fingerprint of times and sizes of everything sent, in hexadecimal: equal for equal runs.
    pub trace: String,
    /// Bytes and screen errors over time.
    pub series: Vec<Sample>,
    /// Pictures and their errors against the settled picture: the first frame, instants of the plan, the last picture.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub pictures: Vec<Picture>,
    /// The error of the first seconds, if the plan asks for it and the run settled with a fixed camera.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_seconds: Option<FirstSecondsError>,
}

impl RunResult {
    /// Lower bound on the time to first frame: two round trips (one if the connection is resumed), and the transfer
    /// time of its bytes. WebSocket without TLS also takes two: TCP's handshake, then the upgrade.
    #[must_use]
    pub fn ttff_bound_ms(&self) -> Option<f64> {
        let round_trips = if self.resumed { 1.0 } else { 2.0 };
        let transfer_ms = |bytes: u64| bytes as f64 * 8e3 / self.rate_bits_per_s as f64;
        // Rounded to the microsecond, as other times.
        let bound_ms = |bytes| round_trips * self.rtt_ms + transfer_ms(bytes);
        self.first_frame_bytes.map(|bytes| (bound_ms(bytes) * 1e3).round() / 1e3)
    }
}

/// One line of text.
impl std::fmt::Display for RunResult {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let or_never = |ms: Option<f64>| ms.map_or("never".to_owned(), |ms| format!("{ms:.0} ms"));
        write!(f, "{}: ", self.scene)?;
        if self.technique != Technique::Lodestream.name() {
            write!(f, "{} over ", self.technique)?;
        }
        write!(f, "{}, {}", self.transport, self.link)?;
        if self.resumed {
            write!(f, ", resumed")?;
        }
        if self.rest_ms.is_some() {
            write!(f, ", camera {}", self.camera)?;
        }
        write!(f, ", seed {}: first frame {}", self.seed, or_never(self.ttff_ms))?;
        if let Some(bytes) = self.first_frame_bytes {
            write!(f, " ({bytes} bytes)")?;
        }
        // Baselines do not know occlusion.
        let ours = [Technique::Lodestream, Technique::Published];
        let knows = ours.into_iter().any(|ours| self.technique == ours.name());
        let with_seen = |ms, seen: Option<&Option<f64>>| match seen {
            Some(seen) if knows => format!("{} (where seen {})", or_never(ms), or_never(*seen)),
            _ => or_never(ms),
        };
        for (px, ms) in coarse_first(&self.ttq_ms) {
            write!(f, ", {px} px {}", with_seen(ms, self.unoccluded_ttq_ms.get(px)))?;
        }
        for (px, ms) in coarse_first(&self.rest_ttq_ms) {
            write!(f, ", at rest {px} px {}", with_seen(ms, self.rest_unoccluded_ttq_ms.get(px)))?;
        }
        write!(f, ", {} bytes in all", self.total_bytes)?;
        if let Some(requests) = self.requests {
            write!(f, ", {requests} requests")?;
        }
        write!(f, ", {}", self.ended)
    }
}

/// Times by screen error, the largest first.
fn coarse_first(times: &BTreeMap<String, Option<f64>>) -> Vec<(&str, Option<f64>)> {
    let mut list: Vec<_> = times.iter().map(|(px, ms)| (px.as_str(), *ms)).collect();
    let size = |px: &str| px.parse().unwrap_or(0.0_f64);
    list.sort_by(|a, b| size(b.0).total_cmp(&size(a.0)));
    list
}

/// The key of a screen error in [`RunResult::ttq_ms`], as short as possible.
#[must_use]
pub fn error_name(px: f64) -> String {
    px.to_string()
}

/// The bytes of a JSON file: an array with one object per line.
///
/// # Errors
/// Errors of the serialiser; results contain only values that JSON can represent.
pub fn to_json<T: Serialize>(objects: &[T]) -> serde_json::Result<Vec<u8>> {
    let mut json = b"[".to_vec();
    for (i, object) in objects.iter().enumerate() {
        json.extend_from_slice(if i == 0 { b"\n" } else { b",\n" });
        serde_json::to_writer(&mut json, object)?;
    }
    json.extend_from_slice(b"\n]\n");
    Ok(json)
}
