//! How much work goes into small packs.

use std::fmt;
use std::str::FromStr;

use lodestream_geometry::{Named, Settings, UnknownName};
use lodestream_import::texture::TextureEffort;

/// Work that goes into small packs. As text `full` or `least`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Effort {
    /// For packs that are sent over networks.
    #[default]
    Full,
    /// For packs that stay on a machine: chunks in one part and on one grid, which are measured once, and textures with the
    /// least effort. Errors are bounded as ever.
    Least,
}

impl Effort {
    /// Settings of simplification with this effort.
    pub(super) fn simplify(self, settings: Settings) -> Settings {
        match self {
            Self::Full => settings,
            Self::Least => Settings { parts: 1, coarse_grid: 0.0, ..settings },
        }
    }

    /// Effort of textures.
    pub(super) fn textures(self) -> TextureEffort {
        match self {
            Self::Full => TextureEffort::default(),
            Self::Least => TextureEffort::LEAST,
        }
    }
}

impl Named for Effort {
    const ALL: &'static [Self] = &[Self::Full, Self::Least];

    fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Least => "least",
        }
    }
}

impl fmt::Display for Effort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Effort {
    type Err = UnknownName;

    fn from_str(name: &str) -> Result<Self, UnknownName> {
        Self::from_name(name)
    }
}
