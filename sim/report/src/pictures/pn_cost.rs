//! Cost of curved triangles: a mesh near the eye drawn flat, curved on the device, and with the same triangles
//! generated on the host by the CPU reference.

use std::fmt;
use std::sync::Arc;

use lodestream_protocol::source::SceneSource;
use lodestream_render::{
    AssetGpu, Drawable, Frame, Gpu, Headless, HostMesh, Material, PassId, Placement, PnTriangles, Settings,
    mark_smooth,
};
use lodestream_scenario::plan::Plan;
use lodestream_scenario::stopwatch::{median, paired_ratio, rounded, timed};
use lodestream_scene::view::View;
use serde::Serialize;

use super::painter::{Painter, Studio};
use super::settled::{by_turns, settle};
use crate::image_error::image_error;

/// Bytes per vertex and per face on the device.
const VERTEX_BYTES: usize = 52;
const FACE_BYTES: usize = 12;

/// Measurements for one error bound.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// Largest deviation of edges from their curves, in pixels.
    pub error_px: f32,
    /// Width and height of the frames, which are the plan's viewport.
    pub size_px: [u32; 2],
    /// The graphics adapter.
    pub adapter: String,
    /// Flat triangles.
    pub triangles: usize,
    /// Triangles after subdivision.
    pub curved_triangles: usize,
    /// Device memory of the host's mesh, in bytes.
    pub host_bytes: usize,
    /// Time in which the host subdivided it, for this view only.
    pub host_ms: f64,
    /// Frame time in milliseconds: flat.
    pub flat_ms: f64,
    /// Frame time: curved on the device.
    pub curved_ms: f64,
    /// Frame time: the host's mesh.
    pub host_frame_ms: f64,
    /// Frame time of curved relative to flat: median over consecutive frames.
    pub over_flat: f64,
    /// Frame time of curved relative to the host's mesh.
    pub over_host: f64,
    /// The same for the passes that draw the mesh: lists and surfaces.
    pub passes_over_host: f64,
    /// FLIP error of the curved picture against that of the host's mesh.
    pub flip: f64,
}

/// Settles the plan's case and draws its first mesh at the settled view, `frames` frames for each error bound.
///
/// # Errors
/// Plans with several cases, scenes without a mesh, runs that do not settle, and errors of the graphics device.
pub fn cost(
    plan: &Plan,
    scene: &Arc<dyn SceneSource>,
    gpu: Gpu,
    errors_px: &[f32],
    frames: u32,
) -> anyhow::Result<Vec<Cost>> {
    let adapter = gpu.describe();
    let studio = Studio::new(gpu);
    let mut settled = settle(plan, scene, &studio, [plan.client])?;
    let mut rows = Vec::new();
    for one in &mut settled {
        for &error_px in errors_px {
            let patches = PnTriangles { error_px, ..PnTriangles::default() };
            rows.push(with_error(&mut one.painter, &one.view, patches, frames, &adapter)?);
        }
    }
    Ok(rows)
}

/// Number of variants.
const WAYS: usize = 3;

fn with_error(
    painter: &mut Painter<'_>,
    view: &View,
    patches: PnTriangles,
    frames: u32,
    adapter: &str,
) -> anyhow::Result<Cost> {
    painter.with_mesh(view, Settings { shadows: None, ..Settings::default() }, |headless, frame, mesh| {
        let instance = Placement::default();
        let (width, height) = headless.size();
        let scale_px = f64::from(height) / (2.0 * frame.camera.tan_half_fov(width, height).1);
        let of = (&instance, frame.camera.eye, scale_px);
        // All variants share one material, so that pictures differ only in their triangles.
        let asset = |headless: &Headless, (vertices, faces): &HostMesh| -> anyhow::Result<AssetGpu> {
            let (gpu, materials) = (headless.gpu(), [Material::default()]);
            let mut asset = headless.renderer().create_asset(gpu, mesh.origin(), &materials, &[]);
            asset.update_vertices(gpu, 0, vertices)?;
            asset.update_indices(gpu, 0, 0, faces)?;
            Ok(asset)
        };
        let mut flat = PnTriangles { most: 1, ..patches }.tessellated(headless.gpu(), mesh, of)?;
        mark_smooth(&mut flat.0);
        let own = asset(headless, &flat)?;
        let (cut, host_seconds) = timed(|| patches.tessellated(headless.gpu(), &own, of));
        let cut = cut?;
        let host = asset(headless, &cut)?;
        let (vertices, faces) = cut;
        let curved = Settings { pn_triangles: Some(patches), ..frame.settings };
        let ways: [(&AssetGpu, Settings); WAYS] =
            [(&own, frame.settings), (&own, curved), (&host, frame.settings)];
        let draw = |headless: &mut Headless, way: usize| {
            let (asset, settings) = ways[way];
            let drawables = [Drawable { asset, instances: &[instance] }];
            headless.frame(&Frame { drawables: &drawables, settings, ..frame })
        };
        let mut pictures = Vec::with_capacity(WAYS);
        for way in 0..WAYS {
            draw(headless, way)?;
            pictures.push(headless.picture()?);
        }
        let mut passes = vec![Vec::new(); WAYS];
        let seconds = by_turns(WAYS, frames, |way| draw(headless, way).map(drop))?;
        for _ in 0..frames.max(1) {
            for (way, passes) in passes.iter_mut().enumerate() {
                headless.time_passes(false);
                headless.time_passes(true);
                draw(headless, way)?;
                let drawn = [PassId::Patches, PassId::GBuffer];
                let timings = headless.timings();
                let of_mesh = timings.passes.iter().filter(|time| drawn.contains(&time.pass));
                passes.push(of_mesh.filter_map(|time| time.gpu).map(|time| time.as_secs_f64()).sum::<f64>());
            }
        }
        headless.time_passes(false);
        let ms = |way: usize| rounded(median(seconds[way].clone()) * 1e3, 3);
        Ok(Cost {
            error_px: patches.error_px,
            size_px: [width, height],
            adapter: adapter.to_owned(),
            triangles: flat.1.len(),
            curved_triangles: faces.len(),
            host_bytes: vertices.len() * VERTEX_BYTES + faces.len() * FACE_BYTES,
            host_ms: rounded(host_seconds * 1e3, 3),
            flat_ms: ms(0),
            curved_ms: ms(1),
            host_frame_ms: ms(2),
            over_flat: rounded(paired_ratio(&seconds[1], &seconds[0]), 3),
            over_host: rounded(paired_ratio(&seconds[1], &seconds[2]), 3),
            passes_over_host: rounded(paired_ratio(&passes[1], &passes[2]), 3),
            flip: image_error(&pictures[1], &pictures[2])?.flip,
        })
    })
}

/// One line of text.
impl fmt::Display for Cost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { error_px, triangles, curved_triangles, over_flat, over_host, passes_over_host, .. } = self;
        write!(
            f,
            "{error_px} px: {triangles} triangles become {curved_triangles}; ms a frame {:.1} flat, {:.1} curved, {:.1} as \
             the host's mesh ({} bytes, cut in {:.1} ms); over flat {over_flat}, over the host's {over_host}, its passes \
             {passes_over_host}; FLIP {:.4}",
            self.flat_ms, self.curved_ms, self.host_frame_ms, self.host_bytes, self.host_ms, self.flip
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::plan_and_device;
    use super::*;
    use lodestream_scenario::testing::small_scene;

    #[test]
    fn a_smaller_error_is_more_triangles_and_looks_as_the_hosts() {
        let Some((plan, gpu)) = plan_and_device("[160, 90]") else { return };
        let rows = cost(&plan, &small_scene(), gpu, &[4.0, 0.25], 1).unwrap();
        assert!(rows[0].triangles == rows[1].triangles && rows[0].triangles > 0);
        assert!(rows.iter().all(|row| row.curved_triangles >= row.triangles && row.curved_ms > 0.0));
        assert!(rows[1].curved_triangles >= rows[0].curved_triangles);
    }
}
