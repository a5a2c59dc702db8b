//! `publish`: a scene to objects that any web server, and any daemon, can stream from.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::Args;

use super::outcome::Outcome;
use super::preparation_settings::SceneArguments;
use crate::catalogue::fetch::fetch;
use crate::catalogue::publish::{publish_from, publish_page};
use lodestream_bake::prepare::{Options, cache};
use lodestream_bake::scene;
use lodestream_bake::sources::Sources;
use lodestream_daemon::Page;
use lodestream_store::Objects;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The scene: a scene file (TOML) or models (OBJ, glTF, GLB, PLY, STL), combined to one scene; each a path or a URL. Then
    /// where to publish it: a folder or its URL (file, s3, gs, az, http). Packs are written to packs/, the scene to
    /// NAME.lss; existing objects are not prepared or written again.
    #[arg(value_name = "SCENE.toml | MODEL…  DEST", num_args = 2.., required = true)]
    words: Vec<PathBuf>,
    /// Folder of prepared packs [default: $XDG_CACHE_HOME/lodestream or ~/.cache/lodestream].
    #[arg(long, env = "LODESTREAM_CACHE", value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Write the page for browsers too: the files of this folder, as script/web builds it, and NAME.html, which shows the
    /// scene in a tab.
    #[arg(long, env = "LODESTREAM_PAGE", value_name = "DIR")]
    page: Option<PathBuf>,
    #[command(flatten)]
    preparation_settings: SceneArguments,
    /// Number of threads; the objects do not depend on it [default: one per core].
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Show no progress.
    #[arg(short, long)]
    quiet: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let options = Options {
        preparation_settings: arguments.preparation_settings.resolve(),
        threads: arguments.threads,
        quiet: arguments.quiet,
        keep_levels: false,
        watch: None,
    };
    let (destination, words) =
        arguments.words.split_last().context("name a scene and where to publish it")?;
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    // Deleted at the end of the function.
    let folder = tempfile::tempdir().context("a temporary folder for downloads cannot be created")?;
    let mut local = Vec::with_capacity(words.len());
    for word in words {
        local.push(match word.to_str() {
            Some(url) if Objects::is_url(word) => runtime.block_on(fetch(url, folder.path()))?,
            _ => word.clone(),
        });
    }
    let cache = arguments.cache.clone().or_else(cache::default_folder);
    let cache = cache.context("no cache folder is known; name one with --cache DIR")?;
    let sources = Sources::in_folder(&cache);
    let scene = scene::of_files_in(&local, &options.preparation_settings, &sources)?;
    let page = arguments.page.as_deref().map(Page::load).transpose().context("--page")?;
    let objects = objects(destination)?;
    let done = runtime.block_on(publish_from(&scene, &objects, &cache, &options, &sources))?;
    let shown = match page {
        Some(page) => format!("; page: {}", runtime.block_on(publish_page(&page, &done, &objects))?),
        None => String::new(),
    };
    Ok(Outcome::good(format!("{}: {done}{shown}\n", destination.display())))
}

/// The store or folder to publish to.
fn objects(destination: &Path) -> anyhow::Result<Objects> {
    if Objects::is_url(destination) {
        return Ok(Objects::of_url(&destination.to_string_lossy())?);
    }
    std::fs::create_dir_all(destination).with_context(|| destination.display().to_string())?;
    Ok(Objects::of_folder(destination)?)
}
