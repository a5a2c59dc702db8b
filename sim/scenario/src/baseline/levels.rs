//! Discrete levels of detail of a prepared asset, with the errors that its index states for them.
//!
//! A level is the ancestor-closed cut of lowest stated error within a number of faces, the best mesh of that size that
//! this project produces (BENCHMARKS.md compares it with other simplifiers).

use anyhow::Context as _;
use lodestream_compress::{decode_base, plain_chunk};
use lodestream_geometry::ancestor_closed_cut::{Budget, Member, lowest_error};
use lodestream_geometry::index::{CHUNKS_PER_PAGE, decode_page, page_count};
use lodestream_geometry::mesh::QuantisedMesh;
use lodestream_geometry::screen::{visible_error, visible_error_at};
use lodestream_protocol::source::SceneSource;
use lodestream_scene::asset::AssetDescription;
use lodestream_scene::{BlobId, BlobPart};
use lodestream_store::LoadedAsset;

/// Reads all chunks of an asset of a scene, from the blobs that a server sends.
pub(super) fn load(scene: &dyn SceneSource, asset: u32) -> anyhow::Result<LoadedAsset> {
    let read = |part| scene.read(&BlobId::Asset { asset, part });
    let blob = read(BlobPart::Base)?;
    let base_bytes = blob.len() as u64;
    let base = decode_base(&blob)?;
    let description = AssetDescription::decode(&base.description)?;
    let (mut infos, mut index_bytes) = (Vec::new(), 0);
    for page in 0..u32::try_from(page_count(base.chunk_count as usize))? {
        let blob = read(BlobPart::IndexPage(page))?;
        index_bytes += blob.len() as u64;
        infos.extend(decode_page(&blob, page * CHUNKS_PER_PAGE as u32)?);
    }
    let (mut chunks, mut payload_bytes) = (Vec::with_capacity(infos.len()), 0);
    for chunk in 0..base.chunk_count {
        let blob = read(BlobPart::Chunk(chunk))?;
        payload_bytes += blob.len() as u64;
        chunks.push(plain_chunk(base.codec, &blob)?.into_owned());
    }
    Ok(LoadedAsset { base, description, infos, chunks, payload_bytes, base_bytes, index_bytes })
}

/// Faces of an asset with all chunks applied.
pub(super) fn faces(asset: &LoadedAsset) -> u64 {
    let more: u64 = asset.infos.iter().map(|info| u64::from(info.faces)).sum();
    asset.base.faces.len() as u64 + more
}

/// A mesh and its visible error, in the asset's units.
pub(super) struct Level {
    pub(super) mesh: QuantisedMesh,
    pub(super) error: f32,
}

/// The level with at most `most_faces` faces, or the base mesh if that has more.
pub(super) fn level(asset: &LoadedAsset, most_faces: u64) -> anyhow::Result<Level> {
    let set = lowest_error(&asset.base, &asset.infos, asset.head_bytes(), Budget::Faces(most_faces));
    let mesh = asset.refined(&set.members).context("a level cannot be computed")?.to_mesh();
    Ok(Level { mesh, error: error_of(asset, &set.members) })
}

/// The largest visible error of the chunks that an ancestor-closed cut lacks.
fn error_of(asset: &LoadedAsset, set: &[Member]) -> f32 {
    let mut left: Vec<f32> = asset.infos.iter().map(|info| visible_error(info, 1.0)).collect();
    for &Member { chunk, truncation } in set {
        let info = &asset.infos[chunk as usize];
        left[chunk as usize] =
            truncation.map_or(0.0, |_| visible_error_at(info, &info.extent(truncation), 1.0));
    }
    left.into_iter().fold(0.0, f32::max)
}

/// Face counts that halve from `all` down to the base mesh's, in ascending order.
pub(super) fn halving(all: u64, base: u64) -> Vec<u64> {
    let mut counts: Vec<u64> =
        std::iter::successors(Some(all), |n| Some(n / 2)).take_while(|&n| n > base && n > 0).collect();
    counts.push(base.min(all));
    counts.dedup();
    counts.reverse();
    counts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::small_scene;

    #[test]
    fn counts_halve_down_to_the_base() {
        assert_eq!(halving(1000, 100), [100, 125, 250, 500, 1000]);
        assert_eq!(halving(1000, 1000), [1000]);
        assert_eq!(halving(7, 9), [7]);
        assert_eq!(halving(0, 0), [0]);
    }

    #[test]
    fn levels_grow_in_faces_and_fall_in_error_down_to_none() {
        let scene = small_scene();
        for number in 0..scene.header().asset_count {
            let asset = load(&*scene, number).unwrap();
            let all = faces(&asset);
            let levels: Vec<Level> = halving(all, asset.base.faces.len() as u64)
                .into_iter()
                .map(|count| {
                    let level = level(&asset, count).unwrap();
                    assert!(level.mesh.faces.len() as u64 <= count.max(asset.base.faces.len() as u64));
                    level
                })
                .collect();
            assert!(levels.is_sorted_by(|a, b| a.error >= b.error), "asset {number}");
            let (first, last) = (&levels[0], levels.last().unwrap());
            assert_eq!((last.mesh.faces.len() as u64, last.error), (all, 0.0), "asset {number}");
            assert_eq!(first.mesh.faces.len(), asset.base.faces.len(), "asset {number}");
        }
    }
}
