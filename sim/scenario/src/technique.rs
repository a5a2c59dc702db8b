//! The techniques that a plan may name.

use serde::{Deserialize, Serialize};

/// Most requests under way at once: as many connections to a host as browsers open for HTTP/1.1.
pub const MOST_IN_FLIGHT: usize = 6;

/// How a scene's geometry gets from server to client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Technique {
    /// This project's own server and client.
    #[default]
    Lodestream,
    /// A view-dependent peer that is given as data: its nodes, fetched by the project's own selection rule.
    Nodes,
    /// A chain of Draco files with halving numbers of faces, coarse to fine; each replaces the one before.
    Chain,
    /// Each asset as one OBJ file.
    Obj,
    /// The same through gzip.
    ObjGzip,
    /// Each asset as one Draco file.
    Draco,
    /// The scheme of the system that this one follows: levels of 10, 30, 50, 70 and 100 % of the faces as JSON
    /// through gzip, one request at a time.
    SeedJson,
}

impl Technique {
    /// Its name in plans and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lodestream => "lodestream",
            Self::Nodes => "nodes",
            Self::Chain => "chain",
            Self::Obj => "obj",
            Self::ObjGzip => "obj-gzip",
            Self::Draco => "draco",
            Self::SeedJson => "seed-json",
        }
    }

    /// Whether sizes of Draco files are needed.
    #[must_use]
    pub const fn needs_draco(self) -> bool {
        matches!(self, Self::Chain | Self::Draco)
    }

    /// Most requests under way at once.
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
