//! Record of a frame's input, to detect motion and changes in the next one.

use lodestream_scene::pose::Pose;
use lodestream_scene::punctual_lights::PunctualLight;

use crate::frame::placed::PlacedInstances;
use crate::frame::settings::{Frame, Settings};
use crate::passes::water::Water;
use crate::scene::environment::Environment;
use crate::scene::terrain::{TerrainAppearance, TerrainPart};
use lodestream_terrain::tiles::TileRegion;

/// Everything that a picture depends on except jitter and time.
#[derive(Debug, PartialEq)]
struct FrameInput {
    camera: Pose,
    environment: Environment,
    settings: Settings,
    /// [`PlacedInstances::changes`]: drawables, their places, and the state of vertices, faces, materials and textures.
    placed: u64,
    ground: Option<Ground>,
    water: Option<Water>,
    lights: Vec<PunctualLight>,
}

/// Terrain of a frame.
#[derive(Debug, PartialEq)]
struct Ground {
    look: TerrainAppearance,
    parts: Vec<TerrainPart>,
    casters: Vec<TerrainPart>,
    regions: Vec<TileRegion>,
    /// Stamps of the tiles' heights.
    stamps: Vec<u64>,
}

/// The input of a drawn frame.
#[derive(Debug)]
pub(crate) struct PreviousFrame {
    pub(super) time_s: f32,
    /// Whether vertices were morphing.
    moving: bool,
    made: FrameInput,
}

impl PreviousFrame {
    /// `placed` has the frame's drawables.
    pub(crate) fn of(frame: &Frame<'_>, placed: &PlacedInstances) -> Self {
        let ground = frame.terrain.map(|ground| Ground {
            look: ground.terrain.look,
            parts: ground.parts.to_vec(),
            casters: ground.casters.to_vec(),
            regions: ground.regions.to_vec(),
            stamps: ground
                .parts
                .iter()
                .chain(ground.casters)
                .map(|part| ground.terrain.slot(part.slot).stamp)
                .collect(),
        });
        Self {
            time_s: frame.time_s,
            moving: placed.are_moving(frame.time_s, frame.settings.morph_s),
            made: FrameInput {
                camera: frame.camera,
                environment: frame.environment,
                settings: frame.settings,
                placed: placed.changes(),
                ground,
                water: frame.water,
                lights: frame.lights.to_vec(),
            },
        }
    }

    /// Whether both frames show the same picture.
    pub(crate) fn is(&self, other: &Self) -> bool {
        !self.moving && !other.moving && self.made == other.made
    }

    /// Camera of the frame.
    pub(super) fn camera(&self) -> &Pose {
        &self.made.camera
    }
}
