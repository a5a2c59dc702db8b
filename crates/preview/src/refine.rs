//! Refinement of the base meshes for the start camera: chunks of the first index pages, largest error on the screen
//! first (Hoppe, "View-dependent refinement of progressive meshes", 1997).

use std::cmp::Ordering;
use std::collections::{BTreeSet, BinaryHeap};

use glam::DVec3;
use lodestream_compress::decode_prefix;
use lodestream_geometry::index::{ChunkInfo, decode_page};
use lodestream_geometry::refine::ActiveMesh;
use lodestream_geometry::screen::{scale_px, screen_error_px, visible_error};
use lodestream_scene::asset::AssetDescription;
use lodestream_scene::blob::BlobPart;
use lodestream_scene::description::{AssetEntry, Camera, Instance};

/// Height of the picture for which errors are computed, in pixels.
const HEIGHT_PX: f64 = 720.0;
/// Error on the screen to refine to, in pixels.
const TARGET_PX: f64 = 4.0;
/// Faces of all meshes together up to which chunks are applied.
const MAX_REFINED_FACES: usize = 11_000;

/// An asset while it is refined.
#[derive(Debug)]
pub(crate) struct Refined {
    /// Number in the scene.
    pub(crate) asset: u32,
    pub(crate) mesh: ActiveMesh,
    pub(crate) description: AssetDescription,
    pub(crate) origin: [f64; 3],
}

/// A chunk that can be applied.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    px: f64,
    /// Index into the refined assets.
    refined: usize,
    chunk: u32,
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        let place = |one: &Self| (one.refined, one.chunk);
        self.px.total_cmp(&other.px).then_with(|| place(other).cmp(&place(self)))
    }
}

/// The chunks of one asset's first index page.
struct Index {
    infos: Vec<ChunkInfo>,
    /// Pixels per unit of error.
    px: f64,
    applied: BTreeSet<u32>,
}

impl Index {
    fn candidate(&self, refined: usize, chunk: u32) -> Option<Candidate> {
        let info = self.infos.get(chunk as usize)?;
        let ready = !self.applied.contains(&chunk) && info.parents.iter().all(|p| self.applied.contains(p));
        let px = f64::from(visible_error(info, 1.0)) * self.px;
        (ready && px > TARGET_PX).then_some(Candidate { px, refined, chunk })
    }
}

/// Applies chunks to the meshes. A chunk that does not decode ends the refinement of its asset.
///
/// # Errors
/// Those of `read`.
pub(crate) fn refine<E>(
    assets: &mut [Refined],
    entries: &[&AssetEntry],
    instances: &[&Instance],
    camera: &Camera,
    read: &mut impl FnMut(u32, BlobPart) -> Result<Option<Vec<u8>>, E>,
) -> Result<(), E> {
    let mut indices = Vec::with_capacity(assets.len());
    let mut heap = BinaryHeap::new();
    for (number, refined) in assets.iter().enumerate() {
        let Some(entry) = entries.get(refined.asset as usize).filter(|entry| entry.chunk_count > 0) else {
            indices.push(None);
            continue;
        };
        let page = read(refined.asset, BlobPart::IndexPage(0))?;
        let infos = page.and_then(|page| decode_page(&page, 0).ok()).unwrap_or_default();
        let px = pixels(refined.asset, entry, instances, camera);
        let index = Index { infos, px, applied: BTreeSet::new() };
        heap.extend(
            (0..entry.chunk_count)
                .map_while(|chunk| index.infos.get(chunk as usize).map(|_| index.candidate(number, chunk)))
                .flatten(),
        );
        indices.push(Some(index));
    }
    let mut faces: usize = assets.iter().map(|refined| refined.mesh.face_count()).sum();
    while let Some(Candidate { refined, chunk, .. }) = heap.pop() {
        let Some(index) = indices.get_mut(refined).and_then(Option::as_mut) else { continue };
        let info = &index.infos[chunk as usize];
        if faces + info.faces as usize > MAX_REFINED_FACES {
            break;
        }
        let target = &mut assets[refined];
        let Some(bytes) = read(target.asset, BlobPart::Chunk(chunk))? else { continue };
        let applied = decode_prefix(&target.mesh, chunk, info, None, &bytes)
            .is_ok_and(|delta| target.mesh.apply(&delta).is_ok());
        if !applied {
            indices[refined] = None;
            continue;
        }
        faces += info.faces as usize;
        index.applied.insert(chunk);
        let children = (chunk + 1..).zip(&index.infos[chunk as usize + 1..]);
        let children = children.filter(|(_, info)| info.parents.contains(&chunk));
        heap.extend(children.filter_map(|(child, _)| index.candidate(refined, child)));
    }
    Ok(())
}

/// Pixels per unit of an asset where it is nearest to the camera.
fn pixels(asset: u32, entry: &AssetEntry, instances: &[&Instance], camera: &Camera) -> f64 {
    let scale = scale_px(HEIGHT_PX, f64::from(camera.fov_y));
    let reach = (DVec3::from(camera.target) - DVec3::from(camera.eye)).length();
    let placed = instances.iter().filter(|instance| instance.asset == asset);
    let each = placed.map(|instance| {
        let size = f64::from(instance.placement.scale);
        let center = instance.to_world(entry.origin, entry.sphere.center);
        let depth = (center - DVec3::from(camera.eye)).length() - f64::from(entry.sphere.radius) * size;
        screen_error_px(size, depth.max(0.1 * reach), scale)
    });
    each.fold(0.0, f64::max)
}
