//! The small demo scene and plans of it, for the tests of this crate and of dependent ones.

use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use lodestream_protocol::source::SceneSource;

use crate::plan::{self, Plan, SceneChoice};
use crate::result::RunResult;
use crate::{run, scene};

/// The small demo scene, prepared once for all tests.
///
/// # Panics
/// If it cannot be prepared.
#[must_use]
pub fn small_scene() -> Arc<dyn SceneSource> {
    static SCENE: OnceLock<Arc<dyn SceneSource>> = OnceLock::new();
    let open = || {
        let cache = tempfile::tempdir().unwrap();
        // Packs stay open, so the folder may be removed.
        let opened: Arc<dyn SceneSource> =
            scene::open(&SceneChoice::DemoSmall, None, cache.path(), true).unwrap();
        opened
    };
    Arc::clone(SCENE.get_or_init(open))
}

/// Runs a plan of the small scene, on two threads.
///
/// # Panics
/// If a run fails.
#[must_use]
pub fn results_of(plan: &Plan) -> Vec<RunResult> {
    let scenes: Vec<_> = plan.scenes.iter().map(|_| small_scene()).collect();
    run(plan, &scenes, NonZeroUsize::new(2).unwrap(), |_| {}).unwrap()
}

/// A plan of the small scene with one sweep.
///
/// # Panics
/// If it is no plan.
#[must_use]
pub fn parse(head: &str, sweep: &str) -> Plan {
    let text = format!("scene = \"demo-small\"\nviewport_px = [640, 360]\n{head}\n[[sweep]]\n{sweep}");
    plan::parse(&text, Path::new("test.toml")).unwrap()
}
