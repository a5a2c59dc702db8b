//! `serve`: prepares a scene's models where needed, then streams.

use std::net::SocketAddr;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;

use super::Outcome;
use super::prepare::PrecisionArguments;
use super::units::{Rate, parse_rate};
use crate::prepare::{Options, cache, prepare_cached};
use crate::scene::{self, Scene};
use crate::store::{DEFAULT_CACHE_BYTES, SceneStore};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Models (OBJ), side by side, or one scene file (TOML).
    #[arg(value_name = "FILE.obj … | SCENE.toml", required = true)]
    files: Vec<PathBuf>,
    /// Rate that each session is limited to: 2Mbit, 500kbit, off.
    #[arg(long, env = "LODESTREAM_RATE", value_name = "RATE", default_value = "off", value_parser = parse_rate)]
    rate: Rate,
    /// Address for QUIC (UDP) and WebSocket (TCP).
    #[arg(long, env = "LODESTREAM_LISTEN", value_name = "ADDRESS", default_value = "127.0.0.1:4433")]
    listen: SocketAddr,
    /// Address for /health and /metrics.
    #[arg(long, env = "LODESTREAM_HTTP", value_name = "ADDRESS", default_value = "127.0.0.1:8080")]
    http: SocketAddr,
    /// Folder of prepared packs [default: $XDG_CACHE_HOME/lodestream or ~/.cache/lodestream].
    #[arg(long, env = "LODESTREAM_CACHE", value_name = "DIR")]
    cache: Option<PathBuf>,
    #[command(flatten)]
    precision: PrecisionArguments,
    /// Threads of preparation [default: as many as there are cores].
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
}

pub(super) fn run(arguments: Arguments) -> anyhow::Result<Outcome> {
    let scene = scene::of_files(&arguments.files)?;
    let cache = match arguments.cache.or_else(cache::default_folder) {
        Some(folder) => folder,
        None => anyhow::bail!("no cache folder is known; name one with --cache DIR"),
    };
    let options = Options {
        precision: arguments.precision.resolve(),
        relief_depth: None,
        threads: arguments.threads,
        quiet: false,
    };
    let source = open_scene(&scene, &cache, &options)?;
    let _ = (arguments.rate, arguments.listen, arguments.http, source);
    anyhow::bail!("this build has no network listener")
}

/// Prepares what is not in the cache and opens all packs.
fn open_scene(scene: &Scene, cache: &Path, options: &Options) -> anyhow::Result<Arc<SceneStore>> {
    let mut packs = Vec::with_capacity(scene.assets.len());
    for asset in &scene.assets {
        let cached = prepare_cached(asset, cache, options)?;
        if let Some(report) = &cached.report {
            for warning in &report.warnings {
                eprintln!("warning: {warning}");
            }
            eprintln!("{}: {report}", asset.name);
        }
        packs.push(cached.pack);
    }
    Ok(Arc::new(SceneStore::new(scene, packs, DEFAULT_CACHE_BYTES)?))
}
