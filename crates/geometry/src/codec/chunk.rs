//! A chunk: births, the region's seeds and interior, then splits, breadth first.
//!
//! One function walks through the chunk for both directions ([`crate::entropy::range_coder::Coder`]), so what
//! an encoder says and what a decoder hears cannot drift apart.

use crate::asset::index::{ChunkInfo, TruncationPoint};
use crate::codec::chunk_coder::{ChunkCoder, Resolution};
use crate::codec::elements::Elements;
use crate::codec::local::Local;
use crate::codec::memory::Memory;
use crate::codec::model::{
    AREAS, BENDS, BIRTH_AXIS, BIRTHS, DEPTHS, FLAG_AREA, FLAG_BEND, FLAG_VALENCE, INTERIOR, MAX_VALENCE,
    MIX_FLAG, MORE_SEEDS, SEED_INTERIOR, SEED_OWNER, SEGMENTS, STREAMS, contexts,
};
use crate::codec::moves::GridOwner;
use crate::codec::numbering::Numbering;
use crate::codec::plan::Guide;
use crate::codec::residual::quarter_octaves;
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

/// Most vertices that one chunk may add: bounds a decoder's work.
pub(crate) const MAX_SPLITS: u32 = 1 << 17;

/// An encoded chunk.
pub(crate) struct Encoded {
    pub(crate) bytes: Vec<u8>,
    pub(crate) delta: ChunkDelta,
    /// The builder's ids of what the chunk adds, in canonical order.
    pub(crate) vertices: Vec<u32>,
    pub(crate) wedges: Vec<u32>,
    pub(crate) faces: Vec<u32>,
    /// What is there at each stopping point before the end.
    pub(crate) truncation_points: Vec<Reached>,
}

/// How far a chunk has come: bytes that suffice, and elements added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Reached {
    pub(crate) bytes: u32,
    pub(crate) added: Elements,
}

impl Reached {
    /// The index's entry of a stopping point with the given error.
    pub(crate) fn truncation(&self, error: f32) -> TruncationPoint {
        let Elements { vertices, wedges, faces } = self.added;
        TruncationPoint { payload_bytes: self.bytes, error, vertices, wedges, faces }
    }
}

/// What the index announces of a truncation.
fn announced(truncation: &TruncationPoint) -> Elements {
    let TruncationPoint { vertices, wedges, faces, .. } = *truncation;
    Elements { vertices, wedges, faces }
}

impl ActiveMesh {
    /// Decodes a chunk's payload against this mesh, to which all its parents are applied. The result
    /// does not depend on what else is applied.
    ///
    /// Cost: 1.2 to 1.7 µs a split (docs/benchmarks/preparation.md); work and memory are bounded whatever the bytes say.
    ///
    /// # Errors
    /// [`ChunkError::Refine`] if a parent is missing, [`ChunkError::Decode`] if the payload is not what `info` announces.
    pub fn decode(&self, chunk: u32, info: &ChunkInfo, payload: &[u8]) -> Result<ChunkDelta, ChunkError> {
        self.decode_prefix(chunk, info, None, payload)
    }

    /// Decodes the beginning of a chunk, up to its stopping point `truncation`, an index of
    /// [`ChunkInfo::truncation_points`]; `None` stands for the whole chunk. `payload` needs the truncation's bytes only;
    /// more do not matter.
    ///
    /// The delta may be applied like a whole chunk's, but no child of the chunk may follow: undo it and
    /// apply the whole first. The chunk itself must not be applied meanwhile.
    ///
    /// # Errors
    /// [`ChunkError::Refine`] if a parent is missing or not whole, or if the chunk is applied, [`ChunkError::Decode`] if
    /// the payload is not what `info` announces.
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

    /// Whether the mesh is as decoding a chunk needs it.
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
                "it has {} truncation_points, not {segments}",
                info.truncation_points.len()
            ));
        }
        if info.vertices > MAX_SPLITS {
            return fail(format!("{} vertices announced, at most {MAX_SPLITS} possible", info.vertices));
        }
        let whole = info.extent(None);
        let ends: Vec<Elements> =
            info.truncation_points.iter().chain([&whole]).take(segments).map(announced).collect();
        let Some(&shift) = self.shifts.get(usize::from(info.level)) else {
            return fail(format!("level {} does not exist", info.level));
        };
        // Before anything is reserved, and before any work.
        let elements = ends.last().map_or(0, Elements::total);
        if elements > max_elements(payload.len()) {
            return fail(format!("{elements} elements announced, more than {} bytes can be", payload.len()));
        }
        let fewest = min_bytes(elements);
        let mut memory = Memory::take();
        let parents = info.parents.clone();
        let decoded = match self.codec {
            Codec::Range | Codec::AxisAligned => {
                let mut decoder = Decoder::new(memory.contexts(), payload);
                let mut hearing = ChunkCoder::hearing(&mut decoder, self, chunk, shift, &mut memory);
                let heard = hearing.chunk(&ends, info.vertices);
                let delta = hearing.heard(heard, parents, &mut memory);
                // Behind a truncation comes what nobody reads.
                let ended = if truncation.is_none() { decoder.end(fewest) } else { Ok(()) };
                memory.keep_contexts(decoder.into_contexts());
                delta.and_then(|delta| ended.map(|()| delta))
            }
            Codec::Zstd if truncation.is_some() => return fail("its codec has no stopping points".into()),
            Codec::Zstd => ZstdStreamDecoder::new(&STREAMS, payload).and_then(|mut decoder| {
                let mut hearing = ChunkCoder::hearing(&mut decoder, self, chunk, shift, &mut memory);
                let heard = hearing.chunk(&ends, info.vertices);
                let delta = hearing.heard(heard, parents, &mut memory)?;
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
    let (bytes, said) = match mesh.codec {
        Codec::Range | Codec::AxisAligned => {
            let mut encoder = Encoder::new(contexts());
            let said = encode_with(&mut encoder, mesh, chunk, source)?;
            (encoder.finish(said.min_bytes()), said)
        }
        Codec::Zstd => {
            let mut encoder = ZstdStreamEncoder::new(&STREAMS);
            let said = encode_with(&mut encoder, mesh, chunk, source)?;
            (encoder.finish(said.min_bytes()), said)
        }
    };
    let ChunkEncoding { local, names, reached: mut truncation_points } = said;
    let added = local.added();
    let tail = |list: &[u32], count: u32| list[list.len() - count as usize..].to_vec();
    // Births come before the gathered region; everything else new comes after it.
    let births = source.records.collapses.iter().filter(|c| c.target == NO_VERTEX).count();
    let mut vertices = names.vertices[..births].to_vec();
    vertices.extend(tail(&names.vertices, added.vertices - id32(births)));
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

/// A chunk that was said.
pub(crate) struct ChunkEncoding<'m> {
    /// The region as it is then.
    local: Local<'m>,
    /// The builder's names of it.
    names: Numbering,
    /// What was reached at each stopping point and at the end.
    reached: Vec<Reached>,
}

impl ChunkEncoding<'_> {
    /// Fewest bytes that justify it.
    fn min_bytes(&self) -> usize {
        self.reached.last().map_or(0, |reached| min_bytes(reached.added.total()))
    }
}

/// Says a chunk to any coder.
pub(crate) fn encode_with<'m, C: Coder>(
    coder: &mut C,
    mesh: &'m ActiveMesh,
    chunk: u32,
    source: &Source<'_>,
) -> Result<ChunkEncoding<'m>, DecodeError> {
    let guide = Guide::new(source);
    let mut vertices = id32(guide.births().len());
    let ends: Vec<Elements> = guide
        .segments()
        .iter()
        .map(|splits| {
            vertices += splits;
            Elements { vertices, ..Elements::default() }
        })
        .collect();
    let mut saying = ChunkCoder::saying(coder, mesh, chunk, guide);
    let reached = saying.chunk(&ends, vertices)?;
    let names = saying.guide.into_inner().map_or_else(Numbering::default, |guide| guide.names);
    Ok(ChunkEncoding { local: saying.local, names, reached })
}

/// One pass over the vertices of a segment.
struct Pass {
    /// The segment, as contexts tell them apart.
    segment: usize,
    /// How many passes came before.
    depth: usize,
    /// Area of a star at the segment's end, were all equal.
    fair: f64,
}

impl<C: Coder> ChunkCoder<'_, '_, C> {
    /// Codes a chunk up to the last of `ends`, whose numbers of vertices are those at the ends of its
    /// segments; `total` is what the whole chunk adds. Answers what was reached at each.
    fn chunk(&mut self, ends: &[Elements], total: u32) -> Result<Vec<Reached>, DecodeError> {
        self.births(total)?;
        self.region()?;
        self.moves()?;
        self.see_textures(0..id32(self.local.faces.len()));
        let local = &self.local;
        let interior = local.vertices.iter().filter(|v| v.interior).count();
        let area: f64 = (0..id32(local.faces.len())).map(|f| local.face_area(f)).sum();
        let mut reached = Vec::with_capacity(ends.len());
        for (segment, end) in ends.iter().enumerate() {
            if let Some(guide) = self.guide.as_mut() {
                guide.begin_segment(segment, &self.local);
            }
            // Twice three shares of the area each.
            let fair = 3.0 * area / real((interior + end.vertices as usize).max(1));
            self.segment(end, Pass { segment: segment.min(SEGMENTS - 1), depth: 0, fair })?;
            let added = self.local.added();
            // Vertices can be too many as well: those that start without faces come before any end.
            if self.decodes() && added != *end {
                return Err(DecodeError::new("chunk", format!("it adds {added}; {end} were announced")));
            }
            reached.push(Reached { bytes: id32(self.coder.bytes()), added });
        }
        Ok(reached)
    }

    /// Splits until so many vertices are there: every interior vertex is asked whether it splits; if so, both
    /// halves are asked in the next pass.
    fn segment(&mut self, end: &Elements, mut pass: Pass) -> Result<(), DecodeError> {
        let vertices = &self.local.vertices;
        let mut asked: Vec<u32> =
            (0..id32(vertices.len())).filter(|&v| vertices[v as usize].interior).collect();
        let mut next = Vec::with_capacity(2 * asked.len());
        while self.local.added().vertices < end.vertices {
            // What the next flag depends on is worked out before this one is read, and holds unless this vertex splits:
            // who guesses wrong whether it does need not wait for that as well.
            let mut known = None;
            for (i, &v) in asked.iter().enumerate() {
                if self.local.added().vertices >= end.vertices {
                    break;
                }
                let contexts = known.take().unwrap_or_else(|| self.flag_contexts(v, &pass));
                let ahead = asked.get(i + 1).map(|&next| self.flag_contexts(next, &pass));
                let want = self.guide.as_ref().is_some_and(|g| g.splits(v));
                if !self.flag(contexts, want) {
                    known = ahead;
                    continue;
                }
                let u = self.split(v)?;
                next.extend([v, u]);
                let added = self.local.added();
                if self.decodes() && (added.wedges > end.wedges || added.faces > end.faces) {
                    return Err(DecodeError::new("chunk", "it adds more than was announced"));
                }
            }
            if next.is_empty() && self.local.added().vertices < end.vertices {
                return Err(DecodeError::new("chunk", "it adds fewer vertices than were announced"));
            }
            std::mem::swap(&mut asked, &mut next);
            next.clear();
            pass.depth += 1;
        }
        Ok(())
    }

    /// Whether a vertex splits.
    #[inline(always)]
    fn flag(&mut self, contexts: [usize; 3], want: bool) -> bool {
        if C::MODELS { self.coder.mix(contexts, MIX_FLAG, want) } else { self.coder.bit(FLAG_AREA, want) }
    }

    /// What tells whether a vertex splits: the area of its star, how bent that is, and its valence.
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

    /// Vertices that start without faces: positions relative to one another.
    fn births(&mut self, total: u32) -> Result<(), DecodeError> {
        let Resolution { bits, shift } = self.resolution;
        let wanted = self.guide.as_ref().map_or_else(Vec::new, Guide::births);
        let births = integer(self.coder, BIRTHS, id32(wanted.len()));
        if births > total {
            return Err(DecodeError::new("chunk", "more vertices appear than were announced"));
        }
        let mut previous = [1 << (bits - 1); 3];
        for i in 0..births as usize {
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
            self.local.add_vertex(previous.map(f64::from), None, own);
            if let (Some(guide), Some(name)) = (self.guide.as_mut(), name) {
                guide.names.vertex(name);
            }
            self.coder.check()?;
        }
        Ok(())
    }

    /// Seeds, and from each the interior vertices that it reaches.
    fn region(&mut self) -> Result<(), DecodeError> {
        let Self { coder, mesh, local, guide, .. } = self;
        let needed = guide.as_ref().map_or_else(Vec::new, Guide::needed);
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
            // The owner counts back from this chunk; the base mesh is owner 0.
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
            // A vertex of the outline that no star of the region holds is named without its star, which other
            // regions may change.
            if coder.bit(SEED_INTERIOR, interior(seed)) {
                let mut previous = 0_usize;
                local.explore(seed, &mut |slot, outlook| {
                    let inside = coder.bit(INTERIOR + outlook * 4 + previous, interior(slot));
                    previous = (previous << 1 | usize::from(inside)) & 3;
                    inside
                })?;
            } else {
                local.name_outline(seed)?;
            }
            if let Some(guide) = guide.as_mut() {
                name_gathered(guide, mesh, local);
            }
            coder.check()?;
        }
    }
}

/// Gives the builder's names to what was gathered since the last call.
fn name_gathered(guide: &mut Guide<'_>, mesh: &ActiveMesh, local: &Local<'_>) {
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
