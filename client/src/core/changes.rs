//! What a renderer must fetch: the client's state in steps, each of which leaves a picture without holes.

use std::ops::Range;
use std::sync::Arc;

use lodestream_geometry::refine::RenderVertex;
use lodestream_scene::asset::{Material, TextureInfo};
use lodestream_scene::description::{InstanceEntry, SceneHeader};
use lodestream_scene::punctual_lights::PunctualLight;
use lodestream_scene::shared::SharedTexture;
use lodestream_terrain::{HeightOverride, HeightOverrides};

use super::texture_file::TexturePixels;

/// One step. Steps must be taken in order; each is consistent in itself.
#[derive(Clone, Debug)]
pub enum Change {
    /// A scene begins: forget everything before it.
    Scene(Box<SceneHeader>),
    /// The scene has so many punctual lights, of which those follow that its views want.
    PunctualLights {
        /// How many in all.
        count: u32,
    },
    /// Some of the scene's punctual lights.
    PunctualLightPage {
        /// Their page. Punctual lights come in any order; that of pages is one that all viewers share.
        page: u32,
        /// The punctual lights.
        punctual_lights: Arc<[PunctualLight]>,
    },
    /// More instances; they follow those that came before. Their assets may not be there yet.
    Instances(Vec<InstanceEntry>),
    /// An asset can be drawn from now on: a [`Change::Mesh`] with its base mesh follows at once.
    Asset(NewAsset),
    /// Some slots of an asset's mesh have new contents.
    Mesh(MeshChange),
    /// Everything that the first frame needs lies before this: every visible instance's base mesh, at least. Once a
    /// scene.
    FirstFrame,
    /// A level of a texture was decoded.
    Texture(TextureChange),
    /// The listed points of a patch of the terrain, in place of those it had.
    HeightOverrides {
        /// Column of the patch.
        x: i64,
        /// Row of the patch.
        y: i64,
        /// The overrides.
        overrides: HeightOverrides,
    },
}

/// An asset that can be drawn.
#[derive(Clone, Debug)]
pub struct NewAsset {
    /// Its number.
    pub asset: u32,
    /// Point in asset units that vertices and the sphere are relative to.
    pub origin: [f64; 3],
    /// Centre, relative to `origin`, of a sphere that holds the asset.
    pub center: [f32; 3],
    /// Radius of that sphere, in asset units.
    pub radius: f32,
    /// Materials; at least one.
    pub materials: Vec<Material>,
    /// Textures that the materials name.
    pub textures: Vec<TextureInfo>,
    /// Which of them are those of other assets, to the byte and at every level: a renderer may hold one for all. Each asset
    /// is told of each level all the same.
    pub shared: Vec<SharedTexture>,
}

/// One vertex (a wedge slot).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// Place, normal, texture coordinates.
    pub data: RenderVertex,
    /// When it was first seen, in seconds of the driver's clock; 0 for the base mesh, long before that where it shall not
    /// move to its place but be there.
    pub birth_s: f32,
    /// Level that brought it; 0 is the base mesh.
    pub level: u32,
}

/// Consecutive entries of a material's index list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IndexRun {
    /// The material.
    pub material: u16,
    /// First entry.
    pub first: u32,
    /// Wedge slots of each face; `[0, 0, 0]` where there is none.
    pub faces: Vec<[u32; 3]>,
}

/// New contents of some slots.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshChange {
    /// The asset's number.
    pub asset: u32,
    /// Runs of vertices: first slot, contents.
    pub vertices: Vec<(u32, Vec<Vertex>)>,
    /// Runs of faces.
    pub indices: Vec<IndexRun>,
}

/// A texture level.
#[derive(Clone, Debug)]
pub struct TextureChange {
    /// The asset's number.
    pub asset: u32,
    /// Index of the texture.
    pub texture: u16,
    /// The level; 0 is the coarsest.
    pub level: u8,
    /// The texels; those of a texture that several assets have are held once.
    pub pixels: Arc<TexturePixels>,
}

impl Change {
    /// Memory held, in bytes, roughly.
    #[must_use]
    pub fn bytes(&self) -> usize {
        match self {
            Self::Scene(_) => size_of::<SceneHeader>(),
            Self::FirstFrame | Self::PunctualLights { .. } => 0,
            Self::PunctualLightPage { punctual_lights, .. } => {
                punctual_lights.len() * size_of::<PunctualLight>()
            }
            Self::Instances(list) => list.len() * size_of::<InstanceEntry>(),
            Self::Asset(asset) => (asset.materials.len() + 1) * size_of::<Material>(),
            Self::Mesh(mesh) => {
                mesh.vertices.iter().map(|(_, v)| v.len() * size_of::<Vertex>()).sum::<usize>()
                    + mesh.indices.iter().map(|run| run.faces.len() * 12).sum::<usize>()
            }
            Self::HeightOverrides { overrides, .. } => overrides.len() * size_of::<HeightOverride>(),
            Self::Texture(texture) => texture.pixels.bytes(),
        }
    }
}

/// Consecutive runs that cover ascending `slots`, bridging gaps of up to `gap` slots.
pub(super) fn runs(slots: &[u32], gap: u32) -> Vec<Range<u32>> {
    let mut runs: Vec<Range<u32>> = Vec::new();
    for &slot in slots {
        match runs.last_mut() {
            Some(run) if slot - run.end <= gap => run.end = slot + 1,
            _ => runs.push(slot..slot + 1),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_bridge_small_gaps_only() {
        assert_eq!(runs(&[], 3), []);
        assert_eq!(runs(&[1, 2, 3, 5], 0), [1..4, 5..6]);
        assert_eq!(runs(&[1, 3, 9], 0), [1..2, 3..4, 9..10]);
        assert_eq!(runs(&[1, 3, 9], 1), [1..4, 9..10]);
    }
}
