//! A case: a scene, a link, a transport and a camera path.

use std::path::PathBuf;
use std::sync::Arc;

use lodestream_bake::preparation_settings::PositionBits;
use lodestream_netsim::link::LinkSettings;
use serde::{Deserialize, Serialize};

use crate::camera_path::CameraPath;
use crate::field::Field;
use crate::technique::Technique;

/// Transport between client and server.
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

/// The scene that is streamed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SceneChoice {
    /// The demo scene.
    Demo,
    /// The demo scene's small sibling, for tests.
    DemoSmall,
    /// The generated city, of this many parts.
    City(usize),
    /// A scene without assets.
    Empty,
    /// A scene file.
    File(PathBuf),
    /// A published scene, by path or URL.
    Published(String),
    /// A generated scene of a given size.
    Field(Field),
    /// A single model.
    Model {
        /// Its file, within the folder of models.
        file: String,
        /// The folder, once it is known.
        folder: Option<PathBuf>,
        /// Bits per axis of positions; `None` for the default.
        position_bits: Option<PositionBits>,
    },
}

/// A scene, with its name in the plan.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlanScene {
    /// Name in the report.
    pub name: String,
    /// The scene.
    pub choice: SceneChoice,
}

/// A link in both directions, without the transport's headers.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseLink {
    /// Its name, or its rate, round trip and loss.
    pub name: String,
    /// From server to client.
    pub down: LinkSettings,
    /// From client to server.
    pub up: LinkSettings,
}

/// A scene, a link, a transport and a camera path: the settings of runs that differ in their seeds only.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Index into [`Plan::scenes`](super::Plan::scenes).
    pub scene: usize,
    /// Transport between client and server.
    pub transport: Transport,
    /// Whether the connection is resumed: the client has a ticket and an address token of the server, and nothing else.
    pub resumed: bool,
    /// The link.
    pub link: CaseLink,
    /// The path's name.
    pub camera: String,
    /// The path.
    pub path: CameraPath,
    /// The technique that delivers the scene.
    pub technique: Technique,
    /// Index into [`Plan::peers`](super::Plan::peers), for [`Technique::Nodes`]; `None` without peers.
    pub peer: Option<usize>,
    /// Rate limit of the session; `None` for none. Below the link's rate the queue stays short, so that urgent blobs
    /// arrive sooner.
    pub limiter_bits_per_s: Option<u64>,
    /// Virtual time after which a run ends.
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
