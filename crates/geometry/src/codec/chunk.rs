//! The chunk coder: vertices without faces, the region's seeds and interior, then vertex splits, breadth first.
//!
//! One function codes both directions ([`crate::entropy::range_coder::Coder`]), so encoder and decoder cannot
//! diverge.

use crate::asset::index::{ChunkInfo, TruncationPoint};
use crate::codec::chunk_coder::{ChunkCoder, Resolution};
use crate::codec::elements::Elements;
use crate::codec::local::Local;
use crate::codec::memory::Memory;
use crate::codec::model::{
    AREAS, BENDS, BIRTH_AXIS, BIRTH_PART, BIRTHS, DEPTHS, FLAG_AREA, FLAG_BEND, FLAG_VALENCE, INTERIOR,
    MAX_VALENCE, MIX_FLAG, MORE_SEEDS, SEED_INTERIOR, SEED_OWNER, SEGMENTS, STREAMS, contexts,
};
use crate::codec::moves::GridOwner;
use crate::codec::numbering::Numbering;
use crate::codec::part::code_part;
use crate::codec::plan::SplitPlan;
use crate::codec::residual::quarter_octaves;
use crate::codec::skin::{ExpectedSkin, code_skin};
use crate::codec::source::Source;
use crate::collapse::NO_VERTEX;
use crate::entropy::Codec;
use crate::entropy::allocation_limit::{max_elements, min_bytes};
use crate::entropy::range_coder::{Coder, Decoder, Encoder};
use crate::entropy::symbols::{index, integer, signed};
use crate::entropy::zstd_streams::{ZstdStreamDecoder, ZstdStreamEncoder};
use crate::error::DecodeError;
use crate::mesh::vec3::{dot, sub};
use crate::numbers::{class, id32, real};
use crate::refine::{ActiveMesh, ChunkDelta, ChunkError, Id, RefineError};

/// Most vertices that a chunk may add: bounds a decoder's work.
pub(crate) const MAX_SPLITS: u32 = 1 << 17;

/// An encoded chunk.
pub(crate) struct Encoded {
    pub(crate) bytes: Vec<u8>,
    pub(crate) delta: ChunkDelta,
    /// Builder's ids of the added elements, in canonical order.
    pub(crate) vertices: Vec<u32>,
    pub(crate) wedges: Vec<u32>,
    pub(crate) faces: Vec<u32>,
    /// Size at each truncation point before the end.
    pub(crate) truncation_points: Vec<PrefixSize>,
}

/// Size of a chunk's prefix: bytes that suffice to decode it, and elements it adds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct PrefixSize {
    pub(crate) bytes: u32,
    pub(crate) added: Elements,
}

impl PrefixSize {
    /// The index entry of a truncation point with the given error.
    pub(crate) fn truncation(&self, error: f32) -> TruncationPoint {
        let Elements { vertices, wedges, faces } = self.added;
        TruncationPoint { payload_bytes: self.bytes, error, vertices, wedges, faces }
    }
}

/// Elements that the index states for a truncation point.
fn stated(truncation: &TruncationPoint) -> Elements {
    let TruncationPoint { vertices, wedges, faces, .. } = *truncation;
    Elements { vertices, wedges, faces }
}

impl ActiveMesh {
    /// Decodes a chunk's payload against this mesh, to which all its parents must be applied. The result does not
    /// depend on the other chunks that are applied.
    ///
    /// Cost: 1.2 to 1.7 µs per split (docs/benchmarks/preparation.md); work and memory are bounded for any payload.
    ///
    /// # Errors
    /// [`ChunkError::Refine`] if a parent is missing, [`ChunkError::Decode`] if the payload does not match `info`.
    pub fn decode(&self, chunk: u32, info: &ChunkInfo, payload: &[u8]) -> Result<ChunkDelta, ChunkError> {
        self.decode_prefix(chunk, info, None, payload)
    }

    /// Decodes a prefix of a chunk, up to truncation point `truncation`, an index of
    /// [`ChunkInfo::truncation_points`]; `None` for the whole chunk. `payload` needs only the prefix's bytes; further
    /// bytes are ignored.
    ///
    /// The delta may be applied like a whole chunk's, but then no child of the chunk can be applied: undo it and
    /// apply the whole chunk first. The chunk must not be applied while decoding.
    ///
    /// # Errors
    /// [`ChunkError::Refine`] if a parent is missing or applied up to a truncation point only, or if the chunk is
    /// applied; [`ChunkError::Decode`] if the payload does not match `info`.
    pub fn decode_prefix(
        &self,
        chunk: u32,
        info: &ChunkInfo,
        truncation: Option<u8>,
        payload: &[u8],
    ) -> Result<ChunkDelta, ChunkError> {
        self.may_decode(chunk, info)?;
        Ok(self.decode_checked(chunk, info, truncation, payload)?)
    }

    /// Whether the chunk can be decoded against the mesh as it is.
    fn may_decode(&self, chunk: u32, info: &ChunkInfo) -> Result<(), RefineError> {
        let count = u32::try_from(self.applied.len() - 1).unwrap_or(u32::MAX);
        if chunk >= count {
            return Err(RefineError::NoSuchChunk { chunk, count });
        }
        if let Some(&parent) = info.parents.iter().find(|&&p| p >= chunk || !self.is_applied(p)) {
            return Err(RefineError::MissingParent { chunk, parent });
        }
        if let Some(&parent) = info.parents.iter().find(|&&p| self.applied_truncation(p).is_some()) {
            return Err(RefineError::PartialParent { chunk, parent });
        }
        if self.is_applied(chunk) {
            return Err(RefineError::AlreadyApplied(chunk));
        }
        Ok(())
    }

    fn decode_checked(
        &self,
        chunk: u32,
        info: &ChunkInfo,
        truncation: Option<u8>,
        payload: &[u8],
    ) -> Result<ChunkDelta, DecodeError> {
        let fail = |why: String| Err(DecodeError::new(format!("chunk {chunk}"), why));
        let segments = truncation.map_or(info.truncation_points.len(), usize::from) + 1;
        if truncation.is_some() && segments > info.truncation_points.len() {
            return fail(format!(
                "it has {} truncation points, not {segments}",
                info.truncation_points.len()
            ));
        }
        if info.vertices > MAX_SPLITS {
            return fail(format!("{} vertices stated, at most {MAX_SPLITS} possible", info.vertices));
        }
        let whole = info.extent(None);
        let ends: Vec<Elements> =
            info.truncation_points.iter().chain([&whole]).take(segments).map(stated).collect();
        let Some(&shift) = self.shifts.get(usize::from(info.level)) else {
            return fail(format!("level {} does not exist", info.level));
        };
        // Checked before any allocation or work.
        let elements = ends.last().map_or(0, Elements::total);
        if elements > max_elements(payload.len()) {
            return fail(format!("{elements} elements stated, more than {} bytes allow", payload.len()));
        }
        let fewest = min_bytes(elements);
        let mut memory = Memory::take();
        let parents = info.parents.clone();
        let decoded = match self.codec {
            Codec::Range | Codec::AxisAligned => {
                let mut decoder = Decoder::new(memory.contexts(), payload);
                let mut chunk_coder = ChunkCoder::decoding(&mut decoder, self, chunk, shift, &mut memory);
                let ends_reached = chunk_coder.chunk(&ends, info.vertices);
                let delta = chunk_coder.finish_decoding(ends_reached, parents, &mut memory);
                // Bytes after a truncation point are not read.
                let ended = if truncation.is_none() { decoder.end(fewest) } else { Ok(()) };
                memory.keep_contexts(decoder.into_contexts());
                delta.and_then(|delta| ended.map(|()| delta))
            }
            Codec::Zstd if truncation.is_some() => return fail("its codec has no truncation points".into()),
            Codec::Zstd => ZstdStreamDecoder::new(&STREAMS, payload).and_then(|mut decoder| {
                let mut chunk_coder = ChunkCoder::decoding(&mut decoder, self, chunk, shift, &mut memory);
                let ends_reached = chunk_coder.chunk(&ends, info.vertices);
                let delta = chunk_coder.finish_decoding(ends_reached, parents, &mut memory)?;
                decoder.end(fewest)?;
                Ok(delta)
            }),
        };
        memory.keep();
        let delta = decoded.map_err(|e| DecodeError::new(format!("chunk {chunk}"), e.why))?;
        Ok(ChunkDelta { truncation, ..delta })
    }
}

/// Encodes a chunk against the mesh to which all coarser levels are applied.
pub(crate) fn encode(
    mesh: &ActiveMesh,
    chunk: u32,
    parents: Vec<u32>,
    source: &Source<'_>,
) -> Result<Encoded, DecodeError> {
    let (bytes, encoding) = match mesh.codec {
        Codec::Range | Codec::AxisAligned => {
            let mut encoder = Encoder::new(contexts());
            let encoding = encode_with(&mut encoder, mesh, chunk, source)?;
            (encoder.finish(encoding.min_bytes()), encoding)
        }
        Codec::Zstd => {
            let mut encoder = ZstdStreamEncoder::new(&STREAMS);
            let encoding = encode_with(&mut encoder, mesh, chunk, source)?;
            (encoder.finish(encoding.min_bytes()), encoding)
        }
    };
    let ChunkEncoding { local, names, sizes: mut truncation_points } = encoding;
    let added = local.added();
    let tail = |list: &[u32], count: u32| list[list.len() - count as usize..].to_vec();
    // Vertices without faces precede the gathered region; all other new elements follow it.
    let isolated_vertices = source.records.collapses.iter().filter(|c| c.target == NO_VERTEX).count();
    let mut vertices = names.vertices[..isolated_vertices].to_vec();
    vertices.extend(tail(&names.vertices, added.vertices - id32(isolated_vertices)));
    truncation_points.pop();
    for truncation in &mut truncation_points {
        let fewest = id32(min_bytes(truncation.added.total()));
        truncation.bytes = truncation.bytes.max(fewest).min(id32(bytes.len()));
    }
    Ok(Encoded {
        bytes,
        vertices,
        wedges: tail(&names.wedges, added.wedges),
        faces: tail(&names.faces, added.faces),
        delta: local.delta(chunk, parents),
        truncation_points,
    })
}

/// Result of encoding a chunk.
pub(crate) struct ChunkEncoding<'m> {
    /// The region after the chunk.
    local: Local<'m>,
    /// The builder's ids of the region.
    names: Numbering,
    /// Size at each truncation point and at the end.
    sizes: Vec<PrefixSize>,
}

impl ChunkEncoding<'_> {
    /// Fewest bytes that may encode it.
    fn min_bytes(&self) -> usize {
        self.sizes.last().map_or(0, |sizes| min_bytes(sizes.added.total()))
    }
}

/// Encodes a chunk with any coder.
pub(crate) fn encode_with<'m, C: Coder>(
    coder: &mut C,
    mesh: &'m ActiveMesh,
    chunk: u32,
    source: &Source<'_>,
) -> Result<ChunkEncoding<'m>, DecodeError> {
    let guide = SplitPlan::new(source);
    let mut vertices = id32(guide.isolated_vertices().len());
    let ends: Vec<Elements> = guide
        .segments()
        .iter()
        .map(|splits| {
            vertices += splits;
            Elements { vertices, ..Elements::default() }
        })
        .collect();
    let mut saying = ChunkCoder::encoding(coder, mesh, chunk, guide);
    let sizes = saying.chunk(&ends, vertices)?;
    let names = saying.guide.into_inner().map_or_else(Numbering::default, |guide| guide.names);
    Ok(ChunkEncoding { local: saying.local, names, sizes })
}

/// One pass over the vertices in a segment (the splits between two truncation points).
struct Pass {
    /// The segment, as a context.
    segment: usize,
    /// Number of earlier passes.
    depth: usize,
    /// Mean area of a star at the segment's end.
    fair: f64,
}

impl<C: Coder> ChunkCoder<'_, '_, C> {
    /// Codes a chunk up to the last of `ends`, which hold the vertex counts at the ends of the segments; `total` is
    /// the vertex count of the whole chunk. Returns the size at each end.
    fn chunk(&mut self, ends: &[Elements], total: u32) -> Result<Vec<PrefixSize>, DecodeError> {
        self.isolated_vertices(total)?;
        self.region()?;
        self.moves()?;
        self.record_projections(0..id32(self.local.faces.len()));
        let local = &self.local;
        let interior = local.vertices.iter().filter(|v| v.interior).count();
        let area: f64 = (0..id32(local.faces.len())).map(|f| local.face_area(f)).sum();
        let mut sizes = Vec::with_capacity(ends.len());
        for (segment, end) in ends.iter().enumerate() {
            if let Some(guide) = self.guide.as_mut() {
                guide.begin_segment(segment, &self.local);
            }
            // A star has three shares of the doubled area per vertex, counted twice.
            let fair = 3.0 * area / real((interior + end.vertices as usize).max(1));
            self.segment(end, Pass { segment: segment.min(SEGMENTS - 1), depth: 0, fair })?;
            let added = self.local.added();
            // There may also be too many vertices: those without faces are coded before any end.
            if self.decodes() && added != *end {
                return Err(DecodeError::new("chunk", format!("it adds {added}; {end} were stated")));
            }
            sizes.push(PrefixSize { bytes: id32(self.coder.bytes()), added });
        }
        Ok(sizes)
    }

    /// Splits until `end` is reached: a flag per interior vertex tells whether it splits; both halves are visited in
    /// the next pass.
    fn segment(&mut self, end: &Elements, mut pass: Pass) -> Result<(), DecodeError> {
        let vertices = &self.local.vertices;
        let mut candidates: Vec<u32> =
            (0..id32(vertices.len())).filter(|&v| vertices[v as usize].interior).collect();
        let mut next = Vec::with_capacity(2 * candidates.len());
        while self.local.added().vertices < end.vertices {
            // The next flag's contexts are computed before this flag is read, and hold unless this vertex splits. So
            // the processor does not wait for them after a branch misprediction.
            let mut known = None;
            for (i, &v) in candidates.iter().enumerate() {
                if self.local.added().vertices >= end.vertices {
                    break;
                }
                let contexts = known.take().unwrap_or_else(|| self.flag_contexts(v, &pass));
                let ahead = candidates.get(i + 1).map(|&next| self.flag_contexts(next, &pass));
                let want = self.guide.as_ref().is_some_and(|g| g.splits(v));
                if !self.flag(contexts, want) {
                    known = ahead;
                    continue;
                }
                let u = self.split(v)?;
                next.extend([v, u]);
                let added = self.local.added();
                if self.decodes() && (added.wedges > end.wedges || added.faces > end.faces) {
                    return Err(DecodeError::new("chunk", "it adds more than was stated"));
                }
            }
            if next.is_empty() && self.local.added().vertices < end.vertices {
                return Err(DecodeError::new("chunk", "it adds fewer vertices than were stated"));
            }
            std::mem::swap(&mut candidates, &mut next);
            next.clear();
            pass.depth += 1;
        }
        Ok(())
    }

    /// Codes whether a vertex splits.
    #[inline(always)]
    fn flag(&mut self, contexts: [usize; 3], want: bool) -> bool {
        if C::MODELS { self.coder.mix(contexts, MIX_FLAG, want) } else { self.coder.bit(FLAG_AREA, want) }
    }

    /// Contexts of a split flag: area of the star, its bending, and the valence.
    #[inline]
    fn flag_contexts(&self, v: u32, pass: &Pass) -> [usize; 3] {
        if !C::MODELS {
            return [FLAG_AREA; 3];
        }
        let local = &self.local;
        let area = local.star_area(v);
        let Pass { segment, depth, fair } = *pass;
        let size = class(quarter_octaves(area / fair) / 2 + 6, AREAS);
        let depth = depth.min(DEPTHS - 1);
        let at = local.position(v);
        let bend = local.mean_of_ends(v, 0, at).map_or(0.0, |mean| {
            let lift = sub(at, mean);
            dot(lift, lift) / area.max(1e-9)
        });
        let bend = class(quarter_octaves(bend) / 4 + 7, BENDS);
        let valence = local.valence(v).min(MAX_VALENCE);
        [
            FLAG_AREA + (size * DEPTHS + depth) * SEGMENTS + segment,
            FLAG_BEND + (size * BENDS + bend) * SEGMENTS + segment,
            FLAG_VALENCE + ((depth * (MAX_VALENCE + 1) + valence) * 4 + (size / 4)) * SEGMENTS + segment,
        ]
    }

    /// Codes vertices without faces: positions relative to one another.
    fn isolated_vertices(&mut self, total: u32) -> Result<(), DecodeError> {
        let Resolution { bits, shift } = self.resolution;
        let parts = self.mesh.part_count();
        let wanted = self.guide.as_ref().map_or_else(Vec::new, SplitPlan::isolated_vertices);
        let mut part = 0;
        let isolated_vertices = integer(self.coder, BIRTHS, id32(wanted.len()));
        if isolated_vertices > total {
            return Err(DecodeError::new("chunk", "more vertices appear than were stated"));
        }
        let mut previous = [1 << (bits - 1); 3];
        for i in 0..isolated_vertices as usize {
            let name = wanted.get(i).copied();
            let actual = self.guide.as_ref().and_then(|g| Some((g.source.place)(name?)));
            let own = self.shift(GridOwner::New, shift, actual.map_or(0, |a| a.shift));
            previous = previous.map(|x| x >> own << own);
            for (axis, x) in previous.iter_mut().enumerate() {
                let residual = actual.map_or(0, |p| (p.cell[axis] - *x) >> own);
                *x = x.wrapping_add(signed(self.coder, BIRTH_AXIS, residual).wrapping_shl(own.into()));
                if *x < 0 || *x >= 1 << bits {
                    return Err(DecodeError::new("chunk", "a position is off the grid"));
                }
            }
            if parts > 1 {
                let actual = self.guide.as_ref().and_then(|g| Some(g.source.part(name?))).unwrap_or(0);
                part = code_part(self.coder, BIRTH_PART, part, actual, parts)
                    .ok_or_else(|| DecodeError::new("chunk", "a part is out of range"))?;
                self.local.isolated_parts.push(part);
            }
            self.local.add_vertex(previous.map(f64::from), None, own);
            if self.mesh.kinds.skins {
                let actual = self.guide.as_ref().and_then(|g| Some(g.source.skin(name?)));
                let near = self.local.new_skins.last().copied().unwrap_or_default();
                let skin = code_skin(self.coder, &ExpectedSkin::near(near), actual)?;
                self.local.new_skins.push(skin);
            }
            if let (Some(guide), Some(name)) = (self.guide.as_mut(), name) {
                guide.names.vertex(name);
            }
            self.coder.check()?;
        }
        Ok(())
    }

    /// Codes the seeds, and from each the interior vertices that it reaches.
    fn region(&mut self) -> Result<(), DecodeError> {
        let Self { coder, mesh, local, guide, .. } = self;
        let needed = guide.as_ref().map_or_else(Vec::new, SplitPlan::needed);
        loop {
            let next = guide.as_ref().and_then(|g| {
                needed
                    .iter()
                    .find(|v| !g.names.local_vertex.contains_key(v))
                    .map(|&v| g.source.slot_of_vertex[v as usize])
            });
            if !coder.bit(MORE_SEEDS, next.is_some()) {
                return coder.check();
            }
            // The owner is coded as distance from this chunk; the base mesh is owner 0.
            let want = next.map_or(Id { owner: 0, index: 0 }, |slot| mesh.vertex_id(slot));
            let back = integer(*coder, SEED_OWNER, self.chunk - want.owner);
            let applied =
                self.chunk.checked_sub(back).and_then(|owner| Some((owner, mesh.applied_owner(owner)?)));
            let Some((owner, applied)) = applied else {
                return Err(DecodeError::new("chunk", "a seed lies in a chunk that is not applied"));
            };
            let number = index(*coder, applied.vertices.len(), want.index as usize, "chunk: seed")?;
            let seed = mesh.vertex_slot(Id { owner, index: id32(number) });
            let interior = |slot: u32| {
                let guide = guide.as_ref();
                guide.is_some_and(|g| (g.source.interior)(g.source.vertex_by_slot[slot as usize]))
            };
            // An outline vertex in no star of the region is added without its star, which other regions may change.
            if coder.bit(SEED_INTERIOR, interior(seed)) {
                let mut previous = 0_usize;
                local.explore(seed, &mut |slot, outlook| {
                    let inside = coder.bit(INTERIOR + outlook * 4 + previous, interior(slot));
                    previous = (previous << 1 | usize::from(inside)) & 3;
                    inside
                })?;
            } else {
                local.add_outline_vertex(seed)?;
            }
            if let Some(guide) = guide.as_mut() {
                name_gathered(guide, mesh, local);
            }
            coder.check()?;
        }
    }
}

/// Numbers the elements gathered since the last call.
fn name_gathered(guide: &mut SplitPlan<'_>, mesh: &ActiveMesh, local: &Local<'_>) {
    let (source, names) = (guide.source, &mut guide.names);
    for v in names.vertices.len()..local.vertices.len() {
        names.vertex(source.vertex_by_slot[mesh.vertex_slot(local.vertex_id(id32(v))) as usize]);
    }
    for w in &local.wedges[names.wedges.len()..] {
        names.wedge(source.wedge_by_slot[mesh.wedge_slot(w.id) as usize]);
    }
    for face in local.gathered_faces().skip(names.faces.len()) {
        names.faces.push(source.face_by_slot[mesh.face_slot(face) as usize]);
    }
}
