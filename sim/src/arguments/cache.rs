//! The folder of prepared packs, and the scenes opened from it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use clap::Args;
use lodestream_bake::prepare::cache::default_folder;
use lodestream_protocol::source::SceneSource;
use lodestream_scenario::plan::Plan;
use lodestream_scenario::scene;

// No doc comment: it would take the place of the command's own in --help.
#[derive(Debug, Args)]
pub(crate) struct CacheFolder {
    /// Folder of prepared packs [default: $XDG_CACHE_HOME/lodestream or ~/.cache/lodestream].
    #[arg(long, env = "LODESTREAM_CACHE", value_name = "DIR")]
    cache: Option<PathBuf>,
}

impl CacheFolder {
    /// The named folder, if any.
    pub(crate) fn named(&self) -> Option<&Path> {
        self.cache.as_deref()
    }

    /// The folder.
    ///
    /// # Errors
    /// None is named, and the system has no cache folder.
    pub(crate) fn path(&self) -> anyhow::Result<PathBuf> {
        let path = self.cache.clone().or_else(default_folder);
        path.context("no cache folder is known; name one with --cache DIR")
    }

    /// Opens the scenes of a plan; prepares those that are not in the cache.
    ///
    /// # Errors
    /// A scene that cannot be generated, read or prepared.
    pub(crate) fn open_scenes(&self, plan: &Plan, quiet: bool) -> anyhow::Result<Vec<Arc<dyn SceneSource>>> {
        let folder = self.path()?;
        plan.scenes.iter().map(|scene| scene::open(&scene.choice, plan.codec, &folder, quiet)).collect()
    }
}
