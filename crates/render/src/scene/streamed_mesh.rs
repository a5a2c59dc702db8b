//! A mesh's change that is uploaded over several frames, since a large one would delay a frame. It takes effect when
//! all of it is uploaded ([`AssetGpu::commit`]).

use std::vec::IntoIter;

use lodestream_client::core::{IndexRun, MeshChange, Vertex};

use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::uploads::Uploads;
use crate::resources::vertex::PackedVertex;
use crate::scene::asset::AssetGpu;
use crate::scene::attribute_table::RareAttributes;

/// Largest piece of a run staged at once.
const PIECE_BYTES: usize = 128 << 10;

/// The remaining part of a change.
#[derive(Debug)]
pub(crate) struct StreamedMeshChange {
    /// The asset's number.
    pub(crate) asset: u32,
    vertices: IntoIter<(u32, Vec<Vertex>)>,
    indices: IntoIter<IndexRun>,
    run: Run,
    vertex_slots: u32,
    index_slots: Vec<u32>,
}

/// The rest of a run of slots, with its first slot.
#[derive(Debug)]
enum Run {
    Vertices(u32, IntoIter<Vertex>),
    Faces(u16, u32, IntoIter<[u32; 3]>),
}

impl StreamedMeshChange {
    pub(crate) fn new(change: MeshChange) -> Self {
        let run = Run::Vertices(0, Vec::new().into_iter());
        let MeshChange { asset, vertices, indices, vertex_slots, index_slots } = change;
        let (vertices, indices) = (vertices.into_iter(), indices.into_iter());
        Self { asset, vertices, indices, run, vertex_slots, index_slots }
    }

    /// Stages about `budget_bytes`, at least one slot. Returns the number of bytes and whether the change is complete.
    pub(crate) fn stage(
        &mut self,
        gpu: &Gpu,
        uploads: &mut Uploads,
        asset: &mut AssetGpu,
        budget_bytes: usize,
    ) -> Result<(usize, bool), RenderError> {
        let mut bytes = 0;
        while self.has_more() {
            if bytes >= budget_bytes {
                return Ok((bytes, false));
            }
            let room = (budget_bytes - bytes).min(PIECE_BYTES);
            bytes += match &mut self.run {
                Run::Vertices(first, left) => {
                    let count = (room / size_of::<Vertex>()).clamp(1, left.len());
                    let vertices = left.by_ref().take(count).map(|vertex| (packed(&vertex), rare(&vertex)));
                    asset.stage_vertices(gpu, uploads, *first as usize, vertices)?;
                    *first += count as u32;
                    count * size_of::<Vertex>()
                }
                Run::Faces(material, first, left) => {
                    let count = (room / size_of::<[u32; 3]>()).clamp(1, left.len());
                    let faces = left.by_ref().take(count);
                    asset.stage_indices(gpu, uploads, usize::from(*material), *first as usize, faces)?;
                    *first += count as u32;
                    count * size_of::<[u32; 3]>()
                }
            };
        }
        asset.stage_lengths(self.vertex_slots, &self.index_slots);
        Ok((bytes, true))
    }

    /// Advances to the next run that is not empty.
    fn has_more(&mut self) -> bool {
        loop {
            let left = match &self.run {
                Run::Vertices(_, left) => left.len(),
                Run::Faces(_, _, left) => left.len(),
            };
            if left > 0 {
                return true;
            }
            self.run = if let Some((first, vertices)) = self.vertices.next() {
                Run::Vertices(first, vertices.into_iter())
            } else if let Some(run) = self.indices.next() {
                Run::Faces(run.material, run.first, run.faces.into_iter())
            } else {
                return false;
            };
        }
    }
}

fn packed(v: &Vertex) -> PackedVertex {
    let vertex = PackedVertex::new(v.data.position, v.data.normal, v.data.uv)
        .morphing(v.data.morph_from, v.birth_s)
        .coloured(v.data.color)
        .at_level(v.level)
        .of_part(v.data.part);
    if v.data.smooth { vertex.smooth() } else { vertex }
}

fn rare(v: &Vertex) -> RareAttributes {
    RareAttributes { skin: v.data.skin, second_uv: v.data.second_uv, part: v.data.part }
}
