//! Reads back the triangles of a frame.

use glam::{DVec2, DVec3, Vec3};
use lodestream_scene::placement::Placement;

use crate::cpu_reference::terrain::Tile;
use crate::frame::settings::Frame;
use crate::resources::gpu::{Gpu, RenderError};
use crate::scene::terrain::{TerrainFrame, TerrainPart, shader_morph};
use lodestream_terrain::tiles::{TILE_CELLS, TileRegion};

/// Corners relative to the frame's eye, on world axes.
pub(super) fn triangles(gpu: &Gpu, frame: &Frame<'_>) -> Result<Vec<[DVec3; 3]>, RenderError> {
    let eye = frame.camera.eye;
    let mut all = Vec::new();
    for drawable in frame.drawables {
        let (origin, own) = (drawable.asset.origin(), drawable.asset.triangles(gpu)?);
        let place =
            |placement: &Placement, corner: Vec3| placement.to_world(origin + corner.as_dvec3()) - eye;
        for placement in drawable.instances {
            all.extend(own.iter().map(|corners| corners.map(|corner| place(placement, corner))));
        }
    }
    if let Some(ground) = &frame.terrain {
        let heights = ground.terrain.heights(gpu)?;
        let regions = Regions::new(ground, eye);
        for part in ground.parts {
            add_tile(ground, part, (&heights(part.slot), &regions.of(part)), eye, &mut all);
        }
    }
    Ok(all)
}

/// Rough regions relative to the eye, as in the shader.
struct Regions(Vec<TileRegion>);

impl Regions {
    fn new(ground: &TerrainFrame<'_>, eye: DVec3) -> Self {
        let eye = DVec2::new(eye.x, eye.z);
        let relative = |region: &TileRegion| TileRegion {
            from: region.from - eye,
            to: region.to - eye,
            radius: region.radius,
            morph: region.morph.iter().map(|morph| arrived(*morph)).collect(),
        };
        Self(ground.regions.iter().map(relative).collect())
    }

    fn of(&self, part: &TerrainPart) -> Vec<TileRegion> {
        let taken = |(bit, _): &(u32, &TileRegion)| part.regions >> bit & 1 == 1;
        (0..32).zip(&self.0).filter(taken).map(|(_, region)| region.clone()).collect()
    }
}

fn arrived(morph: [f64; 2]) -> [f64; 2] {
    shader_morph(morph).map(f64::from)
}

fn add_tile(
    ground: &TerrainFrame<'_>,
    part: &TerrainPart,
    (heights, regions): (&[i32], &[TileRegion]),
    eye: DVec3,
    into: &mut Vec<[DVec3; 3]>,
) {
    let look = ground.terrain.look();
    let tile = Tile {
        heights,
        corner: [0, 1].map(|i| part.origin[i] as f64 * look.unit - [eye.x, eye.z][i]),
        step: look.unit * (1_u64 << part.spacing) as f64,
        height_unit: look.height_unit,
        eye_height: eye.y,
        above: ground.above.max(0.0),
        morph: arrived(part.morph),
        spacing: part.spacing,
        regions,
    };
    let side = TILE_CELLS + 1;
    let points: Vec<DVec3> = (0..side * side).map(|i| DVec3::from(tile.place(i % side, i / side))).collect();
    for cell in 0..TILE_CELLS * TILE_CELLS {
        let (x, y) = (cell % TILE_CELLS, cell / TILE_CELLS);
        let quadrant = u8::from(x >= TILE_CELLS / 2) + 2 * u8::from(y >= TILE_CELLS / 2);
        if part.quadrants >> quadrant & 1 == 0 {
            continue;
        }
        let at = |dx: u32, dy: u32| points[((y + dy) * side + x + dx) as usize];
        // As terrain/grid.rs splits cells.
        into.push([at(0, 0), at(1, 1), at(1, 0)]);
        into.push([at(0, 0), at(0, 1), at(1, 1)]);
    }
}
