//! Tests that need a graphics adapter; Mesa's software driver is enough.
//!
//! Without an adapter they fail. `LODESTREAM_SKIP_GPU=1` skips them, and says so.

mod accumulation;
mod accuracy;
mod ahead;
#[cfg(feature = "client")]
mod animated;
mod covering;
mod debug;
mod enlarged;
mod extremes;
mod finite;
mod ground;
mod haze;
mod heights;
mod host;
mod ink;
mod lights;
mod many;
mod many_assets_cost;
#[cfg(feature = "client")]
mod many_parts;
mod materials;
#[cfg(feature = "client")]
mod mesh_memory;
mod moved_parts;
mod occlusion;
mod occlusion_half;
mod occlusion_rays;
mod orthographic;
mod parts;
mod pictures;
mod pn_triangles;
mod reflections;
mod relief;
#[cfg(feature = "client")]
mod scene_parts;
#[cfg(feature = "client")]
mod second_uv;
mod section;
mod shadows;
mod shapes;
#[cfg(feature = "client")]
mod skinned;
mod specular;
mod spheres;
#[cfg(feature = "client")]
mod staged;
mod streaming;
mod studio;
mod switches;
mod target_memory;
mod temporal;
pub(crate) mod terrain;
mod texture_tiles;
mod timing;
mod water;
mod wgsl_operators;
mod wireframe;

use std::io::Write;

use super::{Gpu, Headless};

/// A renderer for pictures of this size, or `None` if these tests are skipped.
pub(crate) fn headless(width: u32, height: u32) -> Option<Headless> {
    if std::env::var("LODESTREAM_SKIP_GPU").is_ok_and(|v| v == "1") {
        // Not `eprintln!`: the test runner would swallow it when the test "passes".
        let test = std::thread::current().name().unwrap_or("a test").to_owned();
        let _ = writeln!(std::io::stderr(), "SKIPPED, NOT PASSED (LODESTREAM_SKIP_GPU=1): {test}");
        return None;
    }
    let gpu = Gpu::headless().expect("these tests need a graphics adapter (or LODESTREAM_SKIP_GPU=1)");
    Some(Headless::new(gpu, width, height).expect("a small picture"))
}

/// Writes a picture to `target/pictures/`, for viewing.
fn keep(headless: &Headless, name: &str) {
    let target = std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target"), Into::into);
    let folder = target.join("pictures");
    std::fs::create_dir_all(&folder).unwrap();
    headless.picture().unwrap().save(folder.join(format!("{name}.png"))).unwrap();
}
