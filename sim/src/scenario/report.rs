//! What a run came to, as JSON.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use serde::Serialize;

use super::plan::Transport;

/// One run of a plan. Times count from the client's connect call, in milliseconds of virtual time;
/// `None` where the time limit came first. Bytes are transport payload that the client received,
/// handshake included: payload of UDP datagrams, or of TCP segments.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunResult {
    /// The scene, as the plan names it.
    pub scene: String,
    /// How client and server talked.
    pub transport: Transport,
    /// Rate of the link.
    pub rate_bits_per_s: u64,
    /// Round trip without queueing.
    pub rtt_ms: f64,
    /// Probability that a packet was lost.
    pub loss: f64,
    /// Length of the link's queue.
    pub queue_bytes: u64,
    /// Rate that the server limited the session to; `None` for no limit.
    pub limiter_bits_per_s: Option<u64>,
    /// Seed of the run.
    pub seed: u64,
    /// Until the client core could draw every visible instance.
    pub ttff_ms: Option<f64>,
    /// Bytes until then.
    pub first_frame_bytes: Option<u64>,
    /// Until no visible part had a larger screen error, by screen error in pixels.
    pub ttq_ms: BTreeMap<String, Option<f64>>,
    /// Bytes until then.
    pub ttq_bytes: BTreeMap<String, Option<u64>>,
    /// Bytes until the selection wanted nothing more, or the time limit.
    pub total_bytes: u64,
    /// When that was.
    pub settled_ms: Option<f64>,
    /// Why the run ended: "settled", "time limit", or why the connection was lost.
    pub ended: String,
    /// Packets from server to client that the link lost at random.
    pub packets_lost: u64,
    /// Packets from server to client that found the link's queue full.
    pub packets_dropped: u64,
    /// Fingerprint of times and sizes of everything sent, in hexadecimal: equal for equal runs.
    pub trace: String,
}

/// One line for people.
impl std::fmt::Display for RunResult {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let or_never = |ms: Option<f64>| ms.map_or("never".to_owned(), |ms| format!("{ms:.0} ms"));
        let transport = match self.transport {
            Transport::Quic => "quic",
            Transport::Ws => "ws",
        };
        let mbit = self.rate_bits_per_s as f64 / 1e6;
        write!(f, "{transport:4} {mbit:>4} Mbit/s, RTT {} ms, loss {} %", self.rtt_ms, self.loss * 100.0)?;
        write!(f, ": first frame {}", or_never(self.ttff_ms))?;
        if let Some(bytes) = self.first_frame_bytes {
            write!(f, " ({bytes} bytes)")?;
        }
        for (px, ms) in &self.ttq_ms {
            write!(f, ", {px} px {}", or_never(*ms))?;
        }
        write!(f, ", {} bytes in all, {}", self.total_bytes, self.ended)
    }
}

/// The name of a screen error in [`RunResult::ttq_ms`]: as short as it can be written.
#[must_use]
pub fn error_name(px: f64) -> String {
    px.to_string()
}

/// Milliseconds of virtual time, exact to the microsecond.
#[must_use]
pub fn milliseconds(ns: u64) -> f64 {
    (ns as f64 / 1e3).round() / 1e3
}

/// The bytes of `results.json`: an array with one object per run, one per line.
///
/// # Errors
/// What the serialiser says; results have no values that JSON lacks.
pub fn to_json(results: &[RunResult]) -> serde_json::Result<Vec<u8>> {
    let mut json = b"[".to_vec();
    for (i, result) in results.iter().enumerate() {
        json.extend_from_slice(if i == 0 { b"\n" } else { b",\n" });
        serde_json::to_writer(&mut json, result)?;
    }
    json.extend_from_slice(b"\n]\n");
    Ok(json)
}

/// Writes `results.json` into a folder, which is created where it is missing. The file appears whole
/// or not at all.
///
/// # Errors
/// What the system refuses.
pub fn write(folder: &Path, results: &[RunResult]) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let temporary = folder.join(".results.json.partial");
    let mut file = std::fs::File::create(&temporary)?;
    file.write_all(&to_json(results).map_err(std::io::Error::other)?)?;
    file.sync_all()?;
    std::fs::rename(&temporary, folder.join("results.json"))
}
