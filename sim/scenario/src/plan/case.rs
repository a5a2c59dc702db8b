//! A case: a scene, a link, a transport over it and a camera path.

use std::path::PathBuf;
use std::sync::Arc;

use lodestream_bake::preparation_settings::PositionBits;
use lodestream_netsim::link::LinkSettings;
use serde::{Deserialize, Serialize};

use crate::camera_path::CameraPath;
use crate::field::Field;
use crate::technique::Technique;

/// How client and server talk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Transport {
    /// QUIC over UDP.
    Quic,
    /// WebSocket over TCP.
    Ws,
}

impl std::fmt::Display for Transport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Quic => "quic",
            Self::Ws => "ws",
        })
    }
}

/// What is streamed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SceneChoice {
    /// The demo scene.
    Demo,
    /// The demo scene's small sibling, for tests.
    DemoSmall,
    /// A scene without anything in it.
    Empty,
    /// A scene file.
    File(PathBuf),
    /// A scene of a given size.
    Field(Field),
    /// A model by itself.
    Model {
        /// Its file, within the folder of models.
        file: String,
        /// The folder, once it is known.
        folder: Option<PathBuf>,
        /// Bits per axis of positions; the default where `None`.
        position_bits: Option<PositionBits>,
    },
}

/// A scene, and how the plan names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlanScene {
    /// For the report.
    pub name: String,
    /// What it is.
    pub choice: SceneChoice,
}

/// A link in both directions, as a plan describes it; headers are the transport's matter.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseLink {
    /// Its name, or its rate, round trip and loss in words.
    pub name: String,
    /// From server to client.
    pub down: LinkSettings,
    /// From client to server.
    pub up: LinkSettings,
}

/// A scene, a link, a transport over it and a camera path: what some runs are about that differ by their seeds.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Index into [`Plan::scenes`](super::Plan::scenes).
    pub scene: usize,
    /// How client and server talk.
    pub transport: Transport,
    /// Whether the client was there before: it then has a ticket and an address token of the server's, and nothing else.
    pub resumed: bool,
    /// The link.
    pub link: CaseLink,
    /// The path's name.
    pub camera: String,
    /// The path.
    pub path: CameraPath,
    /// How the scene gets to the client.
    pub technique: Technique,
    /// Index into [`Plan::peers`](super::Plan::peers), for [`Technique::Nodes`]; `None` where no peers are known.
    pub peer: Option<usize>,
    /// Rate that the server limits the session to; `None` for no limit. Below the link's rate its queue stays
    /// short, so that what is urgent arrives sooner.
    pub limiter_bits_per_s: Option<u64>,
    /// Virtual time after which a run is given up.
    pub time_limit_s: f64,
    /// Seeds of the runs.
    pub seeds: Arc<[u64]>,
}

impl std::fmt::Display for Case {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.technique != Technique::Lodestream {
            write!(f, "{} over ", self.technique)?;
        }
        let resumed = if self.resumed { " resumed" } else { "" };
        write!(f, "{}{resumed}, {}", self.transport, self.link.name)?;
        if self.path.moves() { write!(f, ", camera {}", self.camera) } else { Ok(()) }
    }
}

impl Case {
    /// Round trip without queueing and jitter.
    #[must_use]
    pub fn rtt_ms(&self) -> f64 {
        (self.link.down.delay_ns + self.link.up.delay_ns) as f64 / 1e6
    }
}
