//! Plans in TOML: scenes, links, camera paths and the cases that combine them.
//!
//! ```toml
//! scene = "demo"              # "demo", "demo-small", "empty", a scene.toml relative to this file, a single model
//!                             # from the folder of models (--models): "model:stanford-bunny.obj", or a generated
//!                             # field of boulders: "field:assets=10,faces=10000,instances=1000", or the city of so
//!                             # many parts: "city:1000"
//! position_bits = 12          # of single models; the default if absent
//! codec = "auto"              # or "range", "axis-aligned", "zstd": codec of scenes that are prepared for the plan
//! viewport_px = [1280, 720]
//! ttq_px = [1, 4, 16]         # screen errors whose time is reported
//! time_limit_s = 600          # virtual time after which a run ends
//! seeds = 1                   # number of seeds (1, 2, 3 …), or a list of seeds: [3, 14]
//!
//! [client]                    # client settings that differ from the default
//! target_px = 1               # target screen error; the smallest of ttq_px if absent
//! request_depth_bytes = 65536 # bytes kept in flight, instead of rate times round trip
//! prefetch_bases = true       # fetch base meshes of instances out of view, last
//! truncation_points = true    # fetch chunks only up to the truncation point that suffices
//! shadows = false             # refine casters out of view whose shadow falls into view, as the viewer does
//! splits_per_s = 500_000      # rate of decoding and applying; decoding takes no virtual time if absent
//! hidden_last = true          # occluded parts come last; if false, the server does not test occlusion either
//!
//! [link.train]                # a named link: from server to client,
//! down = { rate_trace = { file = "train.txt", at_end = "repeat" }, delay_ms = 40, jitter_ms = 20, reorder = true }
//! up = { rate_bits_per_s = 500_000 }      # and what differs from client to server
//!
//! [camera.lap]                # a named camera path
//! path = "orbit"              # "still", "orbit", "fly-through", "teleport" or "swing"
//! seconds = 12
//!
//! [pictures]                  # draws each run (takes seconds): the first frame, the settled picture, and at
//! at_s = [1, 3]               # seconds since the connect call
//! size_px = [640, 360]        # in the shape of viewport_px
//!
//! [[sweep]]                   # one case for each combination, one run for each of its seeds
//! transport = "quic"          # or "ws"; every value may be a list, and numbers a range:
//! resumed = [false, true]     # over a new connection, or one resumed with a ticket; not for "ws"
//! rate_bits_per_s = { from = 2_000_000, to = 16_000_000, factor = 2 }
//! rtt_ms = [50]
//! loss = [0, 0.01]            # in each direction; must be 0 for "ws"
//! queue_bytes = 65536         # in each direction
//! limiter_share = 0.95        # the server's rate limit, as a share of the link's rate; no limit if absent
//!
//! [[sweep]]
//! transport = "quic"
//! link = "train"              # instead of rate_bits_per_s, rtt_ms …
//! camera = ["still", "lap"]
//! technique = ["lodestream", "obj-gzip"]  # or "nodes", "chain", "obj", "draco", "seed-json"
//! seeds = 30                  # scene, time_limit_s and seeds may be given per sweep
//! ```
//!
//! A direction of a link has one of `rate_bits_per_s`, `rate_steps = [{ from_s = 0, bits_per_s = 2_000_000 }, …]` and
//! `rate_trace` (a file with a number of Mbit/s per line, one line per second; `at_end` selects whether it repeats or
//! holds its last value), `delay_ms`, `jitter_ms` (uniform from 0), `reorder` (whether jitter may change the order),
//! one of `loss` and `burst_loss = { to_bad, to_good, loss_good, loss_bad }` (Gilbert and Elliott, per packet),
//! `queue_bytes` and `mtu_bytes`. A sweep has the same axes, with `rtt_ms` for twice the delay; its `up` gives what
//! differs from client to server.
//!
//! A path starts (`starts`) at the `"first-frame"`, once the start view is `"settled"` (the default of teleports), or
//! at a time in seconds. `orbit` and `teleport` turn the camera by `degrees` around the point that it looks at;
//! `fly-through` covers `distance` times the distance to that point; `swing` looks `degrees` to both sides, `times`
//! times.
//!
//! Cases are ordered by sweep, and within a sweep by scene, transport, new or resumed, then link or rate, round trip,
//! loss, jitter, queue and MTU, then camera, then technique; runs by case, then by seed. A case of technique `nodes` is
//! repeated for each peer of the file that `peers` names (relative to this file) or the command line.

mod axis;
mod camera;
mod case;
mod change;
mod client;
mod fault;
mod link;
mod pictures;
mod seeds;
mod sweep;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::Path;

use lodestream_bake::preparation_settings::{CodecChoice, PositionBits};
use lodestream_client::core::QUALITIES_PX;
use lodestream_geometry::UnknownName;
use serde::Deserialize;

use crate::draco::Encoder;
use crate::peers::{self, Peer};
use crate::technique::Technique;
use camera::CameraFile;
pub use case::{Case, CaseLink, PlanScene, SceneChoice, Transport};
use client::ClientFile;
pub use client::ClientSettings;
use fault::Fault;
pub use fault::PlanError;
use link::LinkFile;
use pictures::PicturesFile;
pub use pictures::{FirstSeconds, PictureSettings};
use seeds::Seeds;
use sweep::{CaseBuilder, Sweep, SweepContext};

/// Longest plan file.
const MAX_PLAN_BYTES: u64 = 1 << 20;

/// A parsed plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The scenes.
    pub scenes: Vec<PlanScene>,
    /// Size of the picture.
    pub viewport_px: [u32; 2],
    /// Screen errors in pixels whose time is reported.
    pub ttq_px: Vec<f64>,
    /// The client's settings.
    pub client: ClientSettings,
    /// Codec of scenes that are prepared for the plan; `None` for the default.
    pub codec: Option<CodecChoice>,
    /// The cases.
    pub cases: Vec<Case>,
    /// Peers given as data.
    pub peers: Vec<Peer>,
    /// Draco's encoder, if available.
    pub draco: Option<Encoder>,
    /// Pictures of each run; `None` for none.
    pub pictures: Option<PictureSettings>,
    /// The plan's TOML text.
    pub text: String,
}

impl Plan {
    /// The same plan with one seed for every case.
    #[must_use]
    pub fn with_seed(mut self, seed: u64) -> Self {
        for case in &mut self.cases {
            case.seeds = [seed].into();
        }
        self
    }

    /// The same plan with other peers: each case of [`Technique::Nodes`] once for each of them.
    #[must_use]
    pub fn with_peers(mut self, peers: Vec<Peer>) -> Self {
        let numbers: Vec<Option<usize>> =
            if peers.is_empty() { vec![None] } else { (0..peers.len()).map(Some).collect() };
        // Cases repeated for earlier peers are merged again.
        self.cases.retain(|case| matches!(case.peer, None | Some(0)));
        let of_case = |case: Case| {
            let own = if case.technique == Technique::Nodes { numbers.clone() } else { vec![None] };
            own.into_iter().map(move |peer| Case { peer, ..case.clone() })
        };
        self.cases = self.cases.into_iter().flat_map(of_case).collect();
        self.peers = peers;
        self
    }

    /// The same plan with a folder of models, for scenes that name a model's file.
    #[must_use]
    pub fn with_models(mut self, models: Option<&Path>) -> Self {
        for scene in &mut self.scenes {
            if let SceneChoice::Model { folder, .. } = &mut scene.choice {
                *folder = models.map(Path::to_owned);
            }
        }
        self
    }

    /// A case's technique, with the peer's name for a peer.
    #[must_use]
    pub fn technique_name(&self, case: &Case) -> String {
        match case.peer.and_then(|peer| self.peers.get(peer)) {
            Some(peer) => format!("{}: {}", case.technique, peer.name),
            None => case.technique.to_string(),
        }
    }

    /// Number of runs.
    #[must_use]
    pub fn runs(&self) -> usize {
        self.cases.iter().map(|case| case.seeds.len()).sum()
    }
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
    seeds: Seeds,
    position_bits: Option<u8>,
    codec: Option<String>,
    #[serde(default)]
    client: ClientFile,
    peers: Option<String>,
    #[serde(default)]
    link: BTreeMap<String, LinkFile>,
    #[serde(default)]
    camera: BTreeMap<String, CameraFile>,
    pictures: Option<PicturesFile>,
    #[serde(default)]
    sweep: Vec<Sweep>,
}

fn default_viewport() -> [u32; 2] {
    [1280, 720]
}

fn default_ttq() -> Vec<f64> {
    vec![1.0, 4.0, 16.0]
}

fn default_time_limit() -> f64 {
    600.0
}

/// Parses the name of a scene; files are relative to the current folder.
///
/// # Errors
/// Unknown names, and single models, which need a plan.
pub fn scene_choice(name: &str) -> Result<SceneChoice, PlanError> {
    let fail = |message: &str| PlanError {
        file: "the command line".to_owned(),
        field: "scene".to_owned(),
        message: format!("{name:?} {message}"),
    };
    match sweep::scene_choice(name, Path::new(""), None).map_err(fail)? {
        SceneChoice::Model { .. } => Err(fail("is a model; name a scene")),
        choice => Ok(choice),
    }
}

/// Reads a plan and the traces that it names.
///
/// # Errors
/// Names the file and the invalid field or line.
pub fn read(path: &Path) -> Result<Plan, PlanError> {
    read_with(path, &[])
}

/// As [`read`], with other values for some keys, each as `KEY=VALUE` in TOML: `client.target_px=4`.
///
/// # Errors
/// As [`read`]; an invalid change is named in place of a field.
pub fn read_with(path: &Path, changes: &[String]) -> Result<Plan, PlanError> {
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
    if changes.is_empty() {
        return parse(&text, path);
    }
    // Faults of the plan as written are reported by its lines.
    parse(&text, path)?;
    let text = change::changed(&text, changes)
        .map_err(|Fault { field, message }| fail(&format!("--set {field}"), message))?;
    parse(&text, path)
}

/// Parses the text of a plan; `path` is named in errors, and scene and trace files are relative to it.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str, path: &Path) -> Result<Plan, PlanError> {
    let file = path.display().to_string();
    let plan: PlanFile = toml::from_str(text).map_err(|error| {
        let line = error.span().map_or(1, |span| 1 + text[..span.start].matches('\n').count());
        let message = error.message().replace('\n', " ");
        PlanError { file: file.clone(), field: format!("line {line}"), message }
    })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let plan = plan.check(folder).map_err(|Fault { field, message }| PlanError { file, field, message })?;
    Ok(Plan { text: text.to_owned(), ..plan })
}

impl PlanFile {
    fn check(self, folder: &Path) -> Result<Plan, Fault> {
        if let Some(i) = self.viewport_px.iter().position(|x| !(1..=16_384).contains(x)) {
            let message = format!("{} is not a size from 1 to 16384", self.viewport_px[i]);
            return Err(Fault::new(format!("viewport_px[{i}]"), message));
        }
        if self.ttq_px.is_empty() {
            return Err(Fault::new("ttq_px", "is empty; name at least one screen error"));
        }
        if let Some(i) = self.ttq_px.iter().position(|x| !QUALITIES_PX.contains(x)) {
            let message =
                format!("{} is not one of the qualities that clients note: {QUALITIES_PX:?}", self.ttq_px[i]);
            return Err(Fault::new(format!("ttq_px[{i}]"), message));
        }
        if self.sweep.is_empty() {
            return Err(Fault::new("sweep", "there is none; add a [[sweep]] with a transport and links"));
        }
        let position_bits = self.position_bits.map(PositionBits::try_from).transpose();
        let position_bits = position_bits.map_err(|why| Fault::new("position_bits", why.to_string()))?;
        let codec = self.codec.as_deref().map(str::parse).transpose();
        let codec = codec.map_err(|why: UnknownName| Fault::new("codec", why.to_string()))?;
        let client = self.client.check(&self.ttq_px).map_err(|fault| fault.within("client"))?;
        let peers = self.peers.as_ref().map(|file| peers::read(&folder.join(file))).transpose();
        let peers = peers.map_err(|why| Fault::new("peers", why.to_string()))?.unwrap_or_default();
        let mut builder = CaseBuilder::new(&SweepContext {
            folder,
            scene: &self.scene,
            position_bits,
            time_limit_s: self.time_limit_s,
            seeds: &self.seeds,
            links: &self.link,
            cameras: &self.camera,
        })?;
        for (s, sweep) in self.sweep.iter().enumerate() {
            builder.expand(sweep).map_err(|fault| fault.within(&format!("sweep[{s}]")))?;
        }
        let (scenes, cases) = builder.finish();
        let viewport_px = self.viewport_px;
        let pictures = self.pictures.map(|file| file.check(viewport_px)).transpose();
        let pictures = pictures.map_err(|fault| fault.within("pictures"))?;
        let plan = Plan {
            scenes,
            viewport_px,
            ttq_px: self.ttq_px,
            client,
            codec,
            cases,
            peers: Vec::new(),
            draco: None,
            pictures,
            text: String::new(),
        };
        Ok(plan.with_peers(peers))
    }
}
