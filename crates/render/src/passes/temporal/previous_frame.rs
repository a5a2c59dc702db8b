//! Record of a frame's input, to detect motion and changes in the next one.

use std::collections::BTreeMap;

use lodestream_scene::placement::Placement;
use lodestream_scene::pose::Pose;
use lodestream_scene::punctual_lights::PunctualLight;

use crate::frame::settings::{Frame, Settings};
use crate::passes::water::Water;
use crate::scene::asset::AssetGpu;
use crate::scene::environment::Environment;
use crate::scene::terrain::{TerrainAppearance, TerrainPart};
use lodestream_terrain::tiles::TileRegion;

/// An asset as a frame drew it.
#[derive(Debug, Default, PartialEq)]
struct DrawnAsset {
    /// The state of its vertices, faces, materials and textures.
    stamps: [u64; 2],
    instances: Vec<Placement>,
    /// Number of its parts' states.
    part_states: u64,
}

/// Everything that a picture depends on except jitter and time.
#[derive(Debug, PartialEq)]
struct FrameInput {
    camera: Pose,
    environment: Environment,
    settings: Settings,
    /// By asset number; all drawables of an asset together.
    drawn: BTreeMap<u64, DrawnAsset>,
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
    pub(crate) fn of(frame: &Frame<'_>) -> Self {
        let mut drawn: BTreeMap<u64, DrawnAsset> = BTreeMap::new();
        for drawable in frame.drawables {
            let asset = drawn.entry(drawable.asset.number()).or_default();
            asset.stamps = drawable.asset.stamps();
            asset.part_states = drawable.asset.part_states_version();
            asset.instances.extend(drawable.instances);
        }
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
        let is_moving = |asset: &AssetGpu| asset.is_moving(frame.time_s, frame.settings.morph_s);
        Self {
            time_s: frame.time_s,
            moving: frame.drawables.iter().any(|drawable| is_moving(drawable.asset)),
            made: FrameInput {
                camera: frame.camera,
                environment: frame.environment,
                settings: frame.settings,
                drawn,
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

    /// The instances of an asset, in the order of its drawables, and the number of its parts' states.
    pub(super) fn instances(&self, asset: &AssetGpu) -> (&[Placement], u64) {
        let drawn = self.made.drawn.get(&asset.number());
        drawn.map_or((&[], 0), |drawn| (&drawn.instances, drawn.part_states))
    }
}
