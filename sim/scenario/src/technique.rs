//! The techniques that a plan may name.

use serde::{Deserialize, Serialize};

/// Most concurrent requests: the connections per host that browsers open for HTTP/1.1.
pub const MOST_IN_FLIGHT: usize = 6;

/// How a scene's geometry is delivered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Technique {
    /// This project's own server and client.
    #[default]
    Lodestream,
    /// This project's client, with a published scene on a static host.
    Published,
    /// A view-dependent peer given as data: its nodes, fetched by the project's own selection rule.
    Nodes,
    /// A chain of Draco files with halving face counts, coarse to fine; each replaces the previous.
    Chain,
    /// Each asset as one OBJ file.
    Obj,
    /// Each asset as one OBJ file with gzip.
    ObjGzip,
    /// Each asset as one Draco file.
    Draco,
    /// The older system's scheme: levels of 10, 30, 50, 70 and 100 % of the faces as JSON with gzip, one request at a
    /// time.
    SeedJson,
}

impl Technique {
    /// Name in plans and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lodestream => "lodestream",
            Self::Published => "published",
            Self::Nodes => "nodes",
            Self::Chain => "chain",
            Self::Obj => "obj",
            Self::ObjGzip => "obj-gzip",
            Self::Draco => "draco",
            Self::SeedJson => "seed-json",
        }
    }

    /// Whether this project's client runs.
    #[must_use]
    pub const fn is_ours(self) -> bool {
        matches!(self, Self::Lodestream | Self::Published)
    }

    /// Whether it needs sizes of Draco files.
    #[must_use]
    pub const fn needs_draco(self) -> bool {
        matches!(self, Self::Chain | Self::Draco)
    }

    /// Most concurrent requests.
    #[must_use]
    pub const fn most_in_flight(self) -> usize {
        match self {
            Self::SeedJson => 1,
            _ => MOST_IN_FLIGHT,
        }
    }
}

impl std::fmt::Display for Technique {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}
