//! Plans: which scene is streamed over which links, as TOML.
//!
//! ```toml
//! scene = "demo"              # "demo", "demo-small", or a scene.toml relative to this file
//! viewport_px = [1280, 720]
//! ttq_px = [1, 4]             # screen errors whose time is reported, of those that the client notes
//! time_limit_s = 600          # virtual time after which a run is given up
//!
//! [[sweep]]                   # one run for each combination
//! transport = "quic"          # or "ws"
//! rate_bits_per_s = [2_000_000, 16_000_000]
//! rtt_ms = [50]
//! loss = [0, 0.01]            # in each direction; must be 0 for "ws"
//! queue_bytes = 65536         # in each direction
//! limiter_share = 0.95        # the server's limit, as a share of the link's rate; without it: no limit
//! ```
//!
//! Runs are in the order of the sweeps, and within a sweep by rate, then round trip, then loss.

use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

use lodestream_client::core::QUALITIES_PX;
use serde::{Deserialize, Serialize};

/// Longest plan file.
const MAX_PLAN_BYTES: u64 = 1 << 20;

/// Most runs of one plan: a slip in a list should not cost hours.
const MAX_RUNS: usize = 10_000;

/// A plan that cannot be run: which file, which field, what is wrong.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}: {field}: {message}")]
pub struct PlanError {
    /// The plan's file.
    pub file: String,
    /// The field (`sweep[1].loss[0]`) or the line (`line 7`).
    pub field: String,
    /// What is wrong with it, and what to do.
    pub message: String,
}

/// How client and server talk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Transport {
    /// QUIC over UDP.
    Quic,
    /// WebSocket over TCP.
    Ws,
}

/// What is streamed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SceneChoice {
    /// The demo scene.
    Demo,
    /// The demo scene's small sibling, for tests.
    DemoSmall,
    /// A scene file.
    File(PathBuf),
}

/// A link and a transport over it: what one run is about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// How client and server talk.
    pub transport: Transport,
    /// Rate of the link, in each direction.
    pub rate_bits_per_s: NonZeroU64,
    /// Round trip without queueing.
    pub rtt_ms: f64,
    /// Probability that a packet is lost, in each direction.
    pub loss: f64,
    /// Length of the link's queue, in each direction.
    pub queue_bytes: u64,
    /// The server's limit, as a share of the link's rate; `None` for no limit. Below 1 the link's queue
    /// stays short, so that what is urgent arrives sooner.
    pub limiter_share: Option<f64>,
}

impl std::fmt::Display for Case {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let transport = match self.transport {
            Transport::Quic => "quic",
            Transport::Ws => "ws",
        };
        let mbit = self.rate_bits_per_s.get() as f64 / 1e6;
        write!(f, "{transport}, {mbit} Mbit/s, RTT {} ms, loss {} %", self.rtt_ms, self.loss * 100.0)
    }
}

impl Case {
    /// Delay in one direction.
    #[must_use]
    pub fn delay_ns(&self) -> u64 {
        // Checked to be below an hour.
        (self.rtt_ms * 0.5e6).round() as u64
    }

    /// The server's limit.
    #[must_use]
    pub fn limiter_bits_per_s(&self) -> Option<u64> {
        // Shares are checked to be from 0.01 to 100, rates to be at most 1e12.
        self.limiter_share.map(|share| (self.rate_bits_per_s.get() as f64 * share).round() as u64)
    }
}

/// A whole plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The scene as the plan names it, for the report.
    pub scene_name: String,
    /// The scene.
    pub scene: SceneChoice,
    /// Size of the picture.
    pub viewport_px: [u32; 2],
    /// Screen errors whose time is reported, in pixels, as the plan writes them; the smallest is what
    /// is refined to.
    pub ttq_px: Vec<f64>,
    /// Virtual time after which a run is given up.
    pub time_limit_s: f64,
    /// The runs.
    pub cases: Vec<Case>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanFile {
    scene: String,
    #[serde(default = "default_viewport")]
    viewport_px: [u32; 2],
    #[serde(default = "default_ttq")]
    ttq_px: Vec<f64>,
    #[serde(default = "default_time_limit")]
    time_limit_s: f64,
    #[serde(default)]
    sweep: Vec<Sweep>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sweep {
    transport: Transport,
    rate_bits_per_s: Vec<u64>,
    rtt_ms: Vec<f64>,
    #[serde(default = "default_loss")]
    loss: Vec<f64>,
    #[serde(default = "default_queue")]
    queue_bytes: u64,
    limiter_share: Option<f64>,
}

fn default_viewport() -> [u32; 2] {
    [1280, 720]
}

fn default_ttq() -> Vec<f64> {
    vec![1.0, 4.0]
}

fn default_time_limit() -> f64 {
    600.0
}

fn default_loss() -> Vec<f64> {
    vec![0.0]
}

fn default_queue() -> u64 {
    64 * 1024
}

/// Reads a plan.
///
/// # Errors
/// Names the file and the field or line that cannot be used.
pub fn read(path: &Path) -> Result<Plan, PlanError> {
    let fail = |field: &str, message: String| PlanError {
        file: path.display().to_string(),
        field: field.to_owned(),
        message,
    };
    let length = std::fs::metadata(path).map_err(|e| fail("file", format!("cannot be read: {e}")))?.len();
    if length > MAX_PLAN_BYTES {
        return Err(fail("file", format!("has {length} bytes; a plan has at most {MAX_PLAN_BYTES}")));
    }
    let text = std::fs::read_to_string(path).map_err(|e| fail("file", format!("cannot be read: {e}")))?;
    parse(&text, path)
}

/// Parses the text of a plan; `path` is named in errors, and scene files are relative to it.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str, path: &Path) -> Result<Plan, PlanError> {
    let fail =
        |field: String, message: String| PlanError { file: path.display().to_string(), field, message };
    let file: PlanFile = toml::from_str(text).map_err(|error| {
        let line = error.span().map_or(1, |span| 1 + text[..span.start].matches('\n').count());
        fail(format!("line {line}"), error.message().replace('\n', " "))
    })?;

    if file.scene.is_empty() {
        return Err(fail("scene".into(), "is empty; name \"demo\", \"demo-small\" or a scene.toml".into()));
    }
    let scene = match file.scene.as_str() {
        "demo" => SceneChoice::Demo,
        "demo-small" => SceneChoice::DemoSmall,
        other => SceneChoice::File(path.parent().unwrap_or(Path::new("")).join(other)),
    };
    if let Some(i) = file.viewport_px.iter().position(|x| !(1..=16_384).contains(x)) {
        let message = format!("{} is not a size from 1 to 16384", file.viewport_px[i]);
        return Err(fail(format!("viewport_px[{i}]"), message));
    }
    if file.ttq_px.is_empty() {
        return Err(fail("ttq_px".into(), "is empty; name at least one screen error".into()));
    }
    if let Some(i) = file.ttq_px.iter().position(|x| !QUALITIES_PX.contains(x)) {
        let message =
            format!("{} is not one of the qualities that clients note: {QUALITIES_PX:?}", file.ttq_px[i]);
        return Err(fail(format!("ttq_px[{i}]"), message));
    }
    if !(file.time_limit_s > 0.0 && file.time_limit_s <= 1e6) {
        let message = format!("{} is not a time from 0 to 1e6 seconds", file.time_limit_s);
        return Err(fail("time_limit_s".into(), message));
    }
    if file.sweep.is_empty() {
        return Err(fail("sweep".into(), "there is none; add a [[sweep]] with a transport and links".into()));
    }
    let mut cases = Vec::new();
    for (s, sweep) in file.sweep.iter().enumerate() {
        let fail = |field: String, message: String| fail(format!("sweep[{s}].{field}"), message);
        sweep.check().map_err(|(field, message)| fail(field, message))?;
        if sweep.runs().is_none_or(|runs| runs > MAX_RUNS - cases.len()) {
            return Err(fail("rate_bits_per_s".into(), format!("the plan has more than {MAX_RUNS} runs")));
        }
        sweep.expand(&mut cases);
    }
    Ok(Plan {
        scene_name: file.scene,
        scene,
        viewport_px: file.viewport_px,
        ttq_px: file.ttq_px,
        time_limit_s: file.time_limit_s,
        cases,
    })
}

impl Sweep {
    /// What cannot be used, as field and message.
    fn check(&self) -> Result<(), (String, String)> {
        let lengths = [
            ("rate_bits_per_s", self.rate_bits_per_s.len()),
            ("rtt_ms", self.rtt_ms.len()),
            ("loss", self.loss.len()),
        ];
        for (name, length) in lengths {
            if length == 0 {
                return Err((name.into(), "is empty; it needs at least one value".into()));
            }
        }
        let out = |name: &str, i: usize, message: String| Err((format!("{name}[{i}]"), message));
        for (i, &rate) in self.rate_bits_per_s.iter().enumerate() {
            if !(1000..=1_000_000_000_000).contains(&rate) {
                return out("rate_bits_per_s", i, format!("{rate} is not a rate from 1e3 to 1e12 bit/s"));
            }
        }
        for (i, &rtt) in self.rtt_ms.iter().enumerate() {
            if !(0.0..=3_600_000.0).contains(&rtt) {
                return out("rtt_ms", i, format!("{rtt} is not a time from 0 to 3.6e6 ms"));
            }
        }
        for (i, &loss) in self.loss.iter().enumerate() {
            if !(0.0..=1.0).contains(&loss) {
                return out("loss", i, format!("{loss} is not a probability from 0 to 1"));
            }
            if loss > 0.0 && self.transport == Transport::Ws {
                let message = format!(
                    "{loss} over \"ws\": TCP's recovery from loss is not modelled yet; use 0, or \"quic\""
                );
                return out("loss", i, message);
            }
        }
        if self.queue_bytes > 1 << 30 {
            return Err(("queue_bytes".into(), format!("{} is above 1 GiB", self.queue_bytes)));
        }
        if let Some(share) = self.limiter_share.filter(|share| !(0.01..=100.0).contains(share)) {
            return Err(("limiter_share".into(), format!("{share} is not a share from 0.01 to 100")));
        }
        Ok(())
    }

    fn runs(&self) -> Option<usize> {
        self.rate_bits_per_s.len().checked_mul(self.rtt_ms.len())?.checked_mul(self.loss.len())
    }

    fn expand(&self, cases: &mut Vec<Case>) {
        for rate in self.rate_bits_per_s.iter().copied().filter_map(NonZeroU64::new) {
            for &rtt_ms in &self.rtt_ms {
                for &loss in &self.loss {
                    cases.push(Case {
                        transport: self.transport,
                        rate_bits_per_s: rate,
                        rtt_ms,
                        loss,
                        queue_bytes: self.queue_bytes,
                        limiter_share: self.limiter_share,
                    });
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "scene = \"demo\"\n[[sweep]]\ntransport = \"quic\"\n\
                        rate_bits_per_s = [2_000_000, 8_000_000]\nrtt_ms = [50]\nloss = [0, 0.01]\n";

    fn parse_at(text: &str) -> Result<Plan, PlanError> {
        parse(text, Path::new("plans/test.toml"))
    }

    #[test]
    fn sweeps_expand_in_order() {
        let plan = parse_at(GOOD).unwrap();
        let found: Vec<_> = plan.cases.iter().map(|c| (c.rate_bits_per_s.get(), c.loss)).collect();
        assert_eq!(found, [(2_000_000, 0.0), (2_000_000, 0.01), (8_000_000, 0.0), (8_000_000, 0.01)]);
        assert_eq!(plan.cases[0].delay_ns(), 25_000_000);
        assert_eq!((plan.viewport_px, plan.ttq_px), ([1280, 720], vec![1.0, 4.0]));
    }

    #[test]
    fn scene_files_are_relative_to_the_plan() {
        let plan = parse_at(&GOOD.replace("demo", "../scenes/a.toml")).unwrap();
        assert_eq!(plan.scene, SceneChoice::File("plans/../scenes/a.toml".into()));
    }

    #[test]
    fn errors_name_file_and_field() {
        let ws = GOOD.replace("\"quic\"", "\"ws\"");
        let cases = [
            (ws.as_str(), "sweep[0].loss[1]", "not modelled"),
            ("scene = \"demo\"", "sweep", "there is none"),
            ("scene = 3", "line 1", "expected a string"),
            ("scene = \"demo\"\nspeed = 3", "line 2", "unknown field"),
            ("scene = \"demo", "line 1", ""),
            (&GOOD.replace("[50]", "[]"), "sweep[0].rtt_ms", "is empty"),
            (&GOOD.replace("[50]", "[-1]"), "sweep[0].rtt_ms[0]", "-1"),
            (&GOOD.replace("[50]", "[nan]"), "sweep[0].rtt_ms[0]", "NaN"),
            (&GOOD.replace("8_000_000", "0"), "sweep[0].rate_bits_per_s[1]", "0 is not"),
            (&GOOD.replace("8_000_000", "-5"), "line 4", ""),
            (&format!("{GOOD}limiter_share = 0\n"), "sweep[0].limiter_share", "0 is not a share"),
            (&GOOD.replace("0.01", "1.5"), "sweep[0].loss[1]", "probability"),
            (&GOOD.replace("quic", "carrier-pigeon"), "line 3", "unknown variant"),
            (&format!("ttq_px = []\n{GOOD}"), "ttq_px", "is empty"),
            (&format!("ttq_px = [1, 0]\n{GOOD}"), "ttq_px[1]", "0 is not"),
            (&format!("viewport_px = [640, 0]\n{GOOD}"), "viewport_px[1]", "0 is not"),
            (&format!("time_limit_s = -1\n{GOOD}"), "time_limit_s", "-1 is not"),
        ];
        for (text, field, message) in cases {
            let error = parse_at(text).unwrap_err();
            assert_eq!(error.file, "plans/test.toml", "{text}");
            assert_eq!(error.field, field, "{text}\n{error}");
            assert!(error.message.contains(message), "{text}\n{error}");
            assert!(!error.to_string().contains('\n'), "{error}");
        }
        let missing = read(Path::new("no/plan.toml")).unwrap_err();
        assert!(missing.to_string().starts_with("no/plan.toml: file: cannot be read"), "{missing}");
    }

    #[test]
    fn endless_plans_are_refused() {
        let many = "2_000_000, ".repeat(MAX_RUNS);
        let error = parse_at(&GOOD.replace("2_000_000", &format!("{many} 2_000_000"))).unwrap_err();
        assert!(error.message.contains("more than"), "{error}");
    }

    #[test]
    fn the_shipped_plans_parse() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("plans");
        let first_frame = read(&folder.join("first-frame.toml")).unwrap();
        assert_eq!(first_frame.cases.len(), 9);
        assert_eq!(first_frame.scene, SceneChoice::Demo);
        let limited = read(&folder.join("limited.toml")).unwrap();
        assert_eq!(limited.cases[0].limiter_bits_per_s(), Some(1_900_000));
        assert_eq!(limited.cases.len(), first_frame.cases.len());
        let short = read(&folder.join("short.toml")).unwrap();
        assert_eq!(short.scene, SceneChoice::DemoSmall);
    }
}
