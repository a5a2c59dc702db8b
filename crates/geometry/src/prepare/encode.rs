//! Encoding, block by block from the stored levels, coarse levels first.

use crate::asset::base::Base;
use crate::codec::chunk::{Encoded, encode};
use crate::codec::source::Source;
use crate::error::{DecodeError, MeshError};
use crate::mesh::QuantisedMesh;
use crate::pool::MonitoredPool;
use crate::prepare::by_slot::BySlot;
use crate::prepare::hooks::Hooks;
use crate::refine::ActiveMesh;
use crate::simplify::hierarchy::RegionChunk;
use crate::simplify::levels::Simplified;

/// Owner of base mesh faces.
const BASE_OWNER: u32 = u32::MAX;

/// The input of encoding.
pub(super) struct Plan<'a> {
    pub(super) mesh: &'a QuantisedMesh,
    pub(super) simplified: &'a Simplified<'a>,
    pub(super) base: &'a Base,
}

/// An encoded chunk.
pub(super) struct EncodedRegion {
    /// The level, counted from the finest.
    pub(super) level: usize,
    pub(super) region: RegionChunk,
    pub(super) parents: Vec<u32>,
    pub(super) encoded: Encoded,
}

/// Encodes all chunks, level by level and block by block; the chunks of a block in parallel, since those of one level
/// are independent. `by_slot` is the base mesh's; `keep` receives the chunks in order.
///
/// The finest level is encoded but not applied: the complete mesh would be the largest allocation of all.
pub(super) fn encode_all(
    plan: &Plan<'_>,
    mut by_slot: BySlot,
    pool: &MonitoredPool<'_>,
    hooks: &Hooks<'_>,
    keep: &mut dyn FnMut(EncodedRegion),
) -> Result<(), MeshError> {
    let &Plan { mesh, simplified, base } = plan;
    let levels = &simplified.levels;
    let internal = |why: String| MeshError::Internal { why };
    let mut active = ActiveMesh::growing(base);
    let mut slot_of_vertex = vec![u32::MAX; mesh.positions.len()];
    for (slot, &v) in by_slot.vertices.iter().enumerate() {
        slot_of_vertex[v as usize] = slot as u32;
    }
    let mut owners = vec![BASE_OWNER; mesh.faces.len()];
    let mut first = 0;
    for (level, block) in (0..levels.count()).rev().flat_map(|l| (0..levels.blocks(l)).map(move |b| (l, b))) {
        let regions = levels.block(level, block)?;
        let parents: Vec<Vec<u32>> =
            (first..).zip(&regions).map(|(id, region)| claim_faces(&mut owners, id, &region.faces)).collect();
        let results = pool.map(regions.len(), &|i| {
            let region = &regions[i];
            let source = Source {
                records: &region.records,
                place: &|v| simplified.placed(v),
                moves: &region.moves,
                shift: simplified.shifts[level],
                wedges: &simplified.wedges,
                faces: &mesh.faces,
                parts: &mesh.parts,
                skins: &mesh.skins,
                vertex_by_slot: &by_slot.vertices,
                wedge_by_slot: &by_slot.wedges,
                face_by_slot: &by_slot.faces,
                slot_of_vertex: &slot_of_vertex,
                interior: &|v| region.interior.binary_search(&v).is_ok(),
            };
            let id = first + i as u32;
            (hooks.observe)(&active, id, &source);
            let encoded = encode(&active, id, parents[i].clone(), &source)?;
            Ok(Encoded { bytes: (hooks.store)(encoded.bytes)?, ..encoded })
        })?;
        first += regions.len() as u32;
        for ((region, parents), result) in regions.into_iter().zip(parents).zip(results) {
            let encoded: Encoded = result.map_err(|e: DecodeError| internal(e.to_string()))?;
            if level == 0 {
                active.would_apply(&encoded.delta).map_err(|e| internal(e.to_string()))?;
            } else {
                active.apply(&encoded.delta).map_err(|e| internal(e.to_string()))?;
                for &v in &encoded.vertices {
                    slot_of_vertex[v as usize] = by_slot.vertices.len() as u32;
                    by_slot.vertices.push(v);
                }
                by_slot.wedges.extend(&encoded.wedges);
                by_slot.faces.extend(&encoded.faces);
            }
            keep(EncodedRegion { level, region, parents, encoded });
        }
    }
    Ok(())
}

/// Parents of a chunk: for each of its faces, the chunk of the nearest coarser level whose region contained the face,
/// whether or not it changed it. (A chunk that only read a face must come first as well, or it would be decoded
/// against a star that a finer chunk has changed.) Then the faces are owned by the chunk itself.
fn claim_faces(owners: &mut [u32], id: u32, faces: &[u32]) -> Vec<u32> {
    let mut parents: Vec<u32> =
        faces.iter().map(|&f| owners[f as usize]).filter(|&owner| owner != BASE_OWNER).collect();
    parents.sort_unstable();
    parents.dedup();
    faces.iter().for_each(|&f| owners[f as usize] = id);
    parents
}
