//! Statistics of a run as JSON, with the simulator's field names.

use std::collections::BTreeMap;

use serde::Serialize;

use lodestream_client::core::{Milestone, QUALITIES_PX, Stats};

use lodestream_render::{PassTime, Timings};

use crate::frames::{FrameLog, ShownFrame};

/// Contents of the file of `--stats`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Report {
    /// Name of the scene.
    pub(crate) scene: String,
    /// "quic" or "ws".
    pub(crate) transport: &'static str,
    /// The server's rate limit; `None` if unlimited.
    pub(crate) rate_bits_per_s: Option<u64>,
    /// Round trip, in milliseconds.
    pub(crate) rtt_ms: Option<f64>,
    /// Share of packets lost; unknown on real links.
    pub(crate) loss: Option<f64>,
    /// Seed of a simulation; none on real links.
    pub(crate) seed: Option<u64>,
    /// Time from the connect call until every visible instance could be drawn.
    pub(crate) ttff_ms: Option<f64>,
    /// Transport payload until then, handshake included.
    pub(crate) first_frame_bytes: Option<u64>,
    /// Time until every visible part had a screen error of at most so many pixels.
    pub(crate) ttq_ms: BTreeMap<String, Option<f64>>,
    /// Transport payload until then.
    pub(crate) ttq_bytes: BTreeMap<String, Option<u64>>,
    /// As `ttq_ms`, without the parts that the scene's own surfaces hide.
    pub(crate) unoccluded_ttq_ms: BTreeMap<String, Option<f64>>,
    /// Transport payload until then.
    pub(crate) unoccluded_ttq_bytes: BTreeMap<String, Option<u64>>,
    /// Transport payload in all, handshakes included.
    pub(crate) total_bytes: u64,
    /// Time until the first complete frame was presented (headless: drawn).
    pub(crate) ttff_presented_ms: Option<f64>,
    /// The frames shown in the first seconds.
    pub(crate) frames: Vec<ShownFrame>,
    /// Whether the picture became as sharp as requested.
    pub(crate) settled: bool,
    /// Time until it was.
    pub(crate) settled_ms: Option<f64>,
    /// Time until the final picture was shown (headless: written), terrain tiles included.
    pub(crate) settled_presented_ms: Option<f64>,
    /// Number of blobs that stay missing because they are damaged or refused.
    pub(crate) lacking_blobs: u64,
    /// The first few of them.
    pub(crate) lacking: Vec<String>,
    /// Bound on the screen error over all visible parts at the end, in pixels; `None` while a visible
    /// instance lacks its base mesh.
    pub(crate) max_screen_error_px: Option<f64>,
    /// Faces at the end, each asset once.
    pub(crate) faces: u64,
    /// Payload bytes of the chunks that the view needs at the end.
    pub(crate) needed_bytes: u64,
    /// Of these, those of chunks that it needs for shadows alone.
    pub(crate) shadow_bytes: u64,
    /// Damaged blobs received.
    pub(crate) decode_failures: u64,
    /// Times of drawing the last frames.
    pub(crate) drawing: Drawing,
}

/// Mean times over the last frames drawn.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Drawing {
    /// Number of frames, at most 30.
    pub(crate) frames: u32,
    /// CPU time of choosing and uploading what is drawn.
    pub(crate) plan_cpu_ms: f64,
    /// The last frame's passes, in order.
    pub(crate) passes: Vec<Pass>,
}

/// Times of a pass.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Pass {
    /// Its name.
    pub(crate) name: &'static str,
    /// CPU time of recording it.
    pub(crate) cpu_ms: f64,
    /// GPU time; `None` if the device has no timestamps.
    pub(crate) gpu_ms: Option<f64>,
}

impl From<&Timings> for Drawing {
    fn from(times: &Timings) -> Self {
        let pass = |&PassTime { pass, cpu, gpu }: &PassTime| Pass {
            name: pass.name(),
            cpu_ms: ms(cpu),
            gpu_ms: gpu.map(ms),
        };
        Self {
            frames: times.frames,
            plan_cpu_ms: ms(times.plan),
            passes: times.passes.iter().map(pass).collect(),
        }
    }
}

fn ms(duration: std::time::Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

impl Report {
    /// The report of a run.
    #[must_use]
    pub(crate) fn new(stats: &Stats, transport: &'static str, shown: &FrameLog) -> Self {
        let first = stats.milestones.first_frame;
        let by_error = |noted: [Option<Milestone>; QUALITIES_PX.len()]| {
            QUALITIES_PX.map(|px| px.to_string()).into_iter().zip(noted)
        };
        let times = |noted| by_error(noted).map(|(px, m)| (px, m.map(|m| ms(m.after)))).collect();
        let sizes = |noted| by_error(noted).map(|(px, m)| (px, m.map(|m| m.bytes))).collect();
        let (all, seen) = (stats.milestones.quality, stats.milestones.unoccluded_quality);
        let error = stats.counters.max_screen_error_px;
        Self {
            scene: stats.scene.clone(),
            transport,
            rate_bits_per_s: stats.rate_bits_per_s,
            rtt_ms: stats.session.rtt.map(ms),
            loss: None,
            seed: None,
            ttff_ms: first.map(|m| ms(m.after)),
            first_frame_bytes: first.map(|m| m.bytes),
            ttq_ms: times(all),
            ttq_bytes: sizes(all),
            unoccluded_ttq_ms: times(seen),
            unoccluded_ttq_bytes: sizes(seen),
            total_bytes: stats.transport_bytes,
            ttff_presented_ms: shown.presented().map(ms),
            frames: shown.frames().to_vec(),
            settled: stats.settled,
            settled_ms: stats.settled_after.map(ms),
            settled_presented_ms: shown.settled().map(ms),
            lacking_blobs: stats.lacking_blobs,
            lacking: stats.lacking.iter().map(ToString::to_string).collect(),
            max_screen_error_px: (first.is_some() && error.is_finite()).then_some(error),
            faces: stats.faces,
            needed_bytes: stats.counters.needed_bytes,
            shadow_bytes: stats.counters.shadow_bytes,
            decode_failures: stats.decode_failures,
            drawing: shown.times().into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Received;
    use lodestream_client::core::Milestones;
    use lodestream_render::PassId;
    use std::time::Duration;

    #[test]
    fn names_and_units_are_those_of_the_simulator() {
        let at = |ms, bytes| Some(Milestone { after: Duration::from_millis(ms), bytes });
        let stats = Stats {
            scene: "demo".into(),
            transport_bytes: 9000,
            milestones: Milestones {
                first_frame: at(200, 1000),
                quality: [at(300, 2000), at(400, 3000), None],
                unoccluded_quality: [at(300, 2000), at(350, 2500), None],
            },
            ..Stats::default()
        };
        let mut shown = FrameLog::default();
        let received = Received { bytes: 1200, error_px: Some(20.0), unoccluded_error_px: Some(15.0) };
        shown.note(Duration::from_millis(250), true, &Default::default(), received);
        let pass = |pass, gpu| PassTime { pass, cpu: Duration::from_micros(250), gpu };
        let passes = vec![pass(PassId::GBuffer, Some(Duration::from_millis(3))), pass(PassId::ToneMap, None)];
        shown.note_times(Timings { frames: 2, plan: Duration::from_millis(1), passes });
        let json = serde_json::to_value(Report::new(&stats, "ws", &shown)).unwrap();
        assert_eq!(json["scene"], "demo");
        assert_eq!(json["transport"], "ws");
        assert_eq!(json["ttff_ms"], 200.0);
        assert_eq!(json["first_frame_bytes"], 1000);
        assert_eq!(json["ttq_ms"]["16"], 300.0);
        assert_eq!(json["ttq_ms"]["4"], 400.0);
        assert_eq!(
            (&json["unoccluded_ttq_ms"]["4"], &json["unoccluded_ttq_bytes"]["4"]),
            (&350.0.into(), &2500.into())
        );
        assert!(json["ttq_ms"]["1"].is_null() && json["seed"].is_null() && json["rate_bits_per_s"].is_null());
        assert_eq!(json["total_bytes"], 9000);
        assert_eq!(json["ttff_presented_ms"], 250.0);
        let frame = &json["frames"][0];
        assert_eq!((&frame["at_ms"], &frame["bytes"]), (&250.0.into(), &1200.into()));
        assert_eq!((&frame["error_px"], &frame["unoccluded_error_px"]), (&20.0.into(), &15.0.into()));
        let drawing = serde_json::json!({
            "frames": 2,
            "plan_cpu_ms": 1.0,
            "passes": [
                { "name": "g_buffer", "cpu_ms": 0.25, "gpu_ms": 3.0 },
                { "name": "tone_map", "cpu_ms": 0.25, "gpu_ms": null },
            ],
        });
        assert_eq!(json["drawing"], drawing);
    }
}
