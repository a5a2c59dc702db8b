//! Changes for a renderer: the client's state in steps, each of which leaves a picture without holes.

use std::ops::Range;
use std::sync::Arc;

use lodestream_geometry::refine::RenderVertex;
use lodestream_scene::animation::AnimatedModel;
use lodestream_scene::asset::{Material, TextureInfo};
use lodestream_scene::blob::Tile;
use lodestream_scene::description::{Instance, SceneHeader};
use lodestream_scene::proxy::{Cut, Proxy};
use lodestream_scene::punctual_lights::PunctualLight;
use lodestream_scene::shared::SharedTexture;
use lodestream_terrain::{HeightOverride, HeightOverrides};

use super::texture_file::TexturePixels;

/// One step of changes. Steps must be applied in order; the picture is complete after each.
#[derive(Clone, Debug)]
pub enum Change {
    /// A new scene begins: discard everything before it.
    Scene(Box<SceneHeader>),
    /// The scene's number of punctual lights; those that the view needs follow in pages.
    PunctualLights {
        /// Number of punctual lights in the scene.
        count: u32,
    },
    /// A page of the scene's punctual lights.
    PunctualLightPage {
        /// Number of the page. Pages arrive in any order; ordered by number, all clients have the same list.
        page: u32,
        /// The punctual lights.
        punctual_lights: Arc<[PunctualLight]>,
    },
    /// More instances, numbered after the earlier ones. Their assets may not have arrived.
    Instances(Vec<Instance>),
    /// More proxies, numbered after the earlier ones: meshes that stand for runs of instances, placed in the world as they
    /// are. From the first one on, a proxy or instance that no [`Change::Cut`] names yet is not drawn.
    Proxies(Vec<Proxy>),
    /// What is drawn from now on, after the meshes of which it consists.
    Cut(Cut),
    /// A new asset; a [`Change::Mesh`] with its base mesh follows at once.
    Asset(NewAsset),
    /// New contents of some slots of an asset's mesh.
    Mesh(MeshChange),
    /// The changes before this one suffice for the first frame: at least the base mesh of every visible instance. Once
    /// per scene, and again after [`ClientCore::restate`](super::ClientCore::restate).
    FirstFrame,
    /// A decoded level of a texture, or a tile of one.
    Texture(TextureChange),
    /// A tile is no longer needed: what is coarser is drawn in its place.
    TileRemoved {
        /// The asset's number.
        asset: u32,
        /// The tile.
        tile: Tile,
    },
    /// An animated model, which moves instances that may not have arrived.
    Animation {
        /// Its number.
        number: u32,
        /// What moves, and its clips.
        model: Arc<AnimatedModel>,
    },
    /// The height overrides of a terrain patch; they replace earlier ones.
    HeightOverrides {
        /// Column of the patch.
        x: i64,
        /// Row of the patch.
        y: i64,
        /// The overrides.
        overrides: HeightOverrides,
    },
}

/// A new asset.
#[derive(Clone, Debug)]
pub struct NewAsset {
    /// Number of the asset.
    pub asset: u32,
    /// Origin of vertices and of the sphere, in asset units.
    pub origin: [f64; 3],
    /// Centre of the bounding sphere, relative to `origin`.
    pub center: [f32; 3],
    /// Radius of the bounding sphere, in asset units.
    pub radius: f32,
    /// Materials; at least one.
    pub materials: Vec<Material>,
    /// Textures that the materials refer to.
    pub textures: Vec<TextureInfo>,
    /// Textures that are identical to those of other assets at every level: a renderer may store them once. Each asset
    /// still gets its own [`TextureChange`]s.
    pub shared: Vec<SharedTexture>,
}

/// One vertex, in a wedge slot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// Position, normal and texture coordinates.
    pub data: RenderVertex,
    /// Start of the vertex's morph, in seconds of the driver's clock: when it was first handed to a renderer; 0 for the
    /// base mesh; far in the past if it must appear without a morph.
    pub birth_s: f32,
    /// Level of the chunk that added it; 0 is the base mesh.
    pub level: u32,
}

/// Consecutive entries of a material's index list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IndexRun {
    /// The material.
    pub material: u16,
    /// First entry.
    pub first: u32,
    /// Wedge slots of each face; `[0, 0, 0]` for an unused entry.
    pub faces: Vec<[u32; 3]>,
}

/// New contents of some slots of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshChange {
    /// The asset's number.
    pub asset: u32,
    /// Runs of vertices: first slot and contents.
    pub vertices: Vec<(u32, Vec<Vertex>)>,
    /// Runs of faces.
    pub indices: Vec<IndexRun>,
    /// Number of vertex slots from now on: no face names a later one.
    pub vertex_slots: u32,
    /// Length of each material's index list from now on.
    pub index_slots: Vec<u32>,
}

/// A texture level, or a tile of one.
#[derive(Clone, Debug)]
pub struct TextureChange {
    /// The asset's number.
    pub asset: u32,
    /// Index of the texture.
    pub texture: u16,
    /// The level; 0 is the coarsest.
    pub level: u8,
    /// The tile, of a level that is cut.
    pub tile: Option<u16>,
    /// The texels; shared by all assets with the same texture.
    pub pixels: Arc<TexturePixels>,
}

impl Change {
    /// Approximate memory of the change, in bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        match self {
            Self::Scene(_) => size_of::<SceneHeader>(),
            Self::FirstFrame | Self::PunctualLights { .. } | Self::TileRemoved { .. } => 0,
            Self::PunctualLightPage { punctual_lights, .. } => {
                punctual_lights.len() * size_of::<PunctualLight>()
            }
            Self::Instances(list) => list.len() * size_of::<Instance>(),
            Self::Proxies(list) => list.len() * size_of::<Proxy>(),
            Self::Cut(cut) => {
                let hidden = cut.partial.iter().map(|partial| 4 + partial.hidden.len() * 8);
                cut.proxies.len() * 4 + cut.covered.len() * 8 + hidden.sum::<usize>()
            }
            Self::Asset(asset) => (asset.materials.len() + 1) * size_of::<Material>(),
            Self::Mesh(mesh) => {
                mesh.vertices.iter().map(|(_, v)| v.len() * size_of::<Vertex>()).sum::<usize>()
                    + mesh.indices.iter().map(|run| run.faces.len() * 12).sum::<usize>()
            }
            Self::HeightOverrides { overrides, .. } => overrides.len() * size_of::<HeightOverride>(),
            Self::Animation { model, .. } => model.memory_bytes(),
            Self::Texture(texture) => texture.pixels.bytes(),
        }
    }
}

/// Ranges that cover ascending `slots`; gaps of up to `gap` slots are included.
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
