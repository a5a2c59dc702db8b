//! Single models: sizes of their packs, and times to show them over a slow link.

use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use lodestream_bake::inspect::inspect;
use lodestream_bake::prepare::{Options, prepare_cached};
use lodestream_bake::scene::Scene;
use lodestream_protocol::source::{Immediate, SceneSource};
use lodestream_store::{BlobCache, DEFAULT_CACHE_BYTES};
use serde::Serialize;

use crate::plan;
use crate::result::RunResult;
use crate::run;

/// The model in its start view at 1280 × 720, refined to one pixel over 2 Mbit/s and 50 ms round trip, over QUIC and
/// over WebSocket.
const PLAN: &str = "scene = \"model:-\"\nttq_px = [1]\n[[sweep]]\ntransport = [\"quic\", \"ws\"]\n\
                    rate_bits_per_s = 2_000_000\nrtt_ms = 50\n";

/// Measurements of a model prepared with default settings.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Model {
    /// Name of its file, without the extension.
    pub model: String,
    /// Vertices that faces use, after welding.
    pub vertices: u64,
    /// Faces.
    pub faces: u64,
    /// Length of the pack, including textures.
    pub pack_bytes: u64,
    /// Bits per vertex of base mesh, index and chunks.
    pub bits_per_vertex: f64,
    /// Length of the base mesh including the description of materials.
    pub base_bytes: u64,
    /// Geometric error of the base mesh relative to the diagonal of the bounding box.
    pub base_error: f64,
    /// Session over QUIC.
    pub quic: Streamed,
    /// Session over WebSocket.
    pub ws: Streamed,
}

/// A session until settled; times since the connect call in virtual time, `None` if never reached.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Streamed {
    /// Why it ended: "settled", or the fault.
    pub ended: String,
    /// Time until the model could be drawn.
    pub ttff_ms: Option<f64>,
    /// Transport payload until then.
    pub first_frame_bytes: Option<u64>,
    /// Time until its screen error was at most one pixel.
    pub ttq_1_ms: Option<f64>,
    /// The same for its visible parts.
    pub unoccluded_ttq_1_ms: Option<f64>,
    /// Transport payload until settled.
    pub total_bytes: u64,
}

impl Streamed {
    fn of(result: &RunResult) -> Self {
        Self {
            ended: result.ended.clone(),
            ttff_ms: result.ttff_ms,
            first_frame_bytes: result.first_frame_bytes,
            ttq_1_ms: result.ttq_ms.get("1").copied().flatten(),
            unoccluded_ttq_1_ms: result.unoccluded_ttq_ms.get("1").copied().flatten(),
            total_bytes: result.total_bytes,
        }
    }
}

/// Prepares a model file, unless its pack is in the cache folder, and streams it.
///
/// # Errors
/// A file that cannot be imported or prepared, or that holds several meshes (each would be an asset of its own).
pub fn measure(file: &Path, cache: &Path) -> anyhow::Result<Model> {
    let context = || file.display().to_string();
    let scene = Scene::of_models(&[file.to_owned()])?;
    let [asset] = &scene.assets[..] else {
        anyhow::bail!("{}: it has {} meshes; name a file with one", context(), scene.assets.len());
    };
    let pack = prepare_cached(asset, cache, &Options { quiet: true, ..Options::default() })?.pack;
    let summary = inspect(pack.path())?;
    let store = lodestream_bake::compose::open(&scene, vec![pack], &BlobCache::new(DEFAULT_CACHE_BYTES))
        .with_context(context)?;
    let source: Arc<dyn SceneSource> = Arc::new(Immediate(store));
    let plan = plan::parse(PLAN, Path::new("models"))?;
    let results = run(&plan, &[source], NonZeroUsize::MIN, |_| ()).with_context(context)?;
    let [quic, ws] = &results[..] else { anyhow::bail!("{}: it was not streamed", context()) };
    Ok(Model {
        model: asset.name.clone(),
        vertices: summary.vertices,
        faces: summary.faces,
        pack_bytes: summary.total_bytes,
        bits_per_vertex: summary.bits_per_vertex,
        base_bytes: summary.base_bytes,
        base_error: summary.base_error / summary.diagonal,
        quic: Streamed::of(quic),
        ws: Streamed::of(ws),
    })
}

impl std::fmt::Display for Model {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}: {} faces, {} bytes, {:.1} bits/vertex, base {} bytes with an error of {:.2} % of the diagonal",
            self.model,
            self.faces,
            self.pack_bytes,
            self.bits_per_vertex,
            self.base_bytes,
            100.0 * self.base_error
        )?;
        for (name, streamed) in [("QUIC", &self.quic), ("WebSocket", &self.ws)] {
            let first = streamed.ttff_ms.map_or("never".to_owned(), |ms| format!("{ms:.0} ms"));
            write!(f, "; {name}: first frame {first}, {}", streamed.ended)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid of 24 × 24 squares over bumps.
    fn bumps() -> String {
        let mut text = String::new();
        for i in 0..25 * 25 {
            let (x, y) = (f64::from(i % 25), f64::from(i / 25));
            text += &format!("v {x} {y} {}\n", (0.4 * x).sin() * (0.3 * y).cos());
        }
        for i in (1..=24 * 25).filter(|i| i % 25 != 0) {
            text += &format!("f {i} {} {} {}\n", i + 1, i + 26, i + 25);
        }
        text
    }

    #[test]
    fn a_model_is_measured_once_and_found_in_the_cache_again() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("bumps.obj");
        std::fs::write(&file, bumps()).unwrap();
        let cache = folder.path().join("cache");
        let found = measure(&file, &cache).unwrap();
        assert_eq!((found.model.as_str(), found.vertices, found.faces), ("bumps", 625, 1152));
        let geometry_bytes = found.bits_per_vertex * 625.0 / 8.0;
        assert!(
            found.base_bytes as f64 <= geometry_bytes && geometry_bytes < found.pack_bytes as f64,
            "{found:?}"
        );
        assert!((0.001..0.1).contains(&found.base_error), "{found:?}");
        for (streamed, round_trips) in [(&found.quic, 1.0), (&found.ws, 2.0)] {
            assert_eq!(streamed.ended, "settled", "{found:?}");
            assert!(streamed.ttff_ms.unwrap() >= round_trips * 50.0, "{found:?}");
            assert!(streamed.ttff_ms <= streamed.unoccluded_ttq_1_ms, "{found:?}");
            assert!(streamed.unoccluded_ttq_1_ms <= streamed.ttq_1_ms, "{found:?}");
            assert!(streamed.first_frame_bytes.unwrap() >= found.base_bytes, "{found:?}");
        }
        assert_eq!(measure(&file, &cache).unwrap(), found);
        assert_eq!(std::fs::read_dir(&cache).unwrap().count(), 1);
    }
}
