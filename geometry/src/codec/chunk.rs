//! A chunk: births, the region's seeds and interior, then rounds of splits.
//!
//! One function walks through the chunk for both directions ([`crate::range_coder::Coder`]), so what
//! an encoder says and what a decoder hears cannot drift apart.

use crate::codec::local::Local;
use crate::codec::model::{FLAG_CONTEXTS, Model};
use crate::codec::plan::{Names, Plan};
use crate::codec::split::{Bits, Wish, code_split};
use crate::error::DecodeError;
use crate::index::ChunkInfo;
use crate::mesh::{QuantisedMesh, Wedge};
use crate::range_coder::{Coder, Decoder, Encoder};
use crate::refine::{ActiveMesh, ChunkDelta, Id};
use crate::symbols::index;

/// Most vertices that one chunk may add: bounds a decoder's work.
pub(crate) const MAX_SPLITS: u32 = 1 << 17;
/// Most flags read in one chunk (interior vertices × rounds).
const MAX_FLAGS: u64 = 1 << 26;

/// What an encoder needs beyond the plan.
pub(crate) struct Source<'a> {
    pub(crate) plan: Plan<'a>,
    pub(crate) mesh: &'a QuantisedMesh,
    /// The builder's wedges: the mesh's, and those kept by collapses.
    pub(crate) wedges: &'a [Wedge],
    pub(crate) materials: &'a [u16],
    /// Builder's ids by slot of the mesh that is encoded against.
    pub(crate) vertex_by_slot: &'a [u32],
    pub(crate) wedge_by_slot: &'a [u32],
    pub(crate) face_by_slot: &'a [u32],
    /// Slots of the builder's vertices that are there.
    pub(crate) slot_of_vertex: &'a [u32],
    /// Whether a builder's vertex is interior to the region.
    pub(crate) interior: &'a (dyn Fn(u32) -> bool + 'a),
}

/// An encoded chunk.
pub(crate) struct Encoded {
    pub(crate) bytes: Vec<u8>,
    pub(crate) delta: ChunkDelta,
    /// The builder's ids of what the chunk adds, in canonical order.
    pub(crate) vertices: Vec<u32>,
    pub(crate) wedges: Vec<u32>,
    pub(crate) faces: Vec<u32>,
}

/// Limits that the index announces.
struct Announced {
    vertices: u32,
    wedges: u32,
    faces: u32,
}

impl ActiveMesh {
    /// Decodes a chunk's payload against this mesh, to which all its parents are applied. The result
    /// does not depend on what else is applied.
    ///
    /// Cost: 4 to 5 µs a split (BENCHMARKS.md); work and memory are bounded whatever the bytes say.
    ///
    /// # Errors
    /// If a parent is missing or the payload is not what `info` announces.
    pub fn decode(&self, chunk: u32, info: &ChunkInfo, payload: &[u8]) -> Result<ChunkDelta, DecodeError> {
        let fail = |why: String| Err(DecodeError::new(format!("chunk {chunk}"), why));
        if chunk as usize + 1 >= self.places.len() {
            return fail(format!("the asset has {} chunks", self.places.len() - 1));
        }
        if let Some(parent) = info.parents.iter().find(|&&p| p >= chunk || !self.is_applied(p)) {
            return fail(format!("its parent {parent} is not applied"));
        }
        let announced = Announced { vertices: info.vertices, wedges: info.wedges, faces: info.faces };
        if announced.vertices > MAX_SPLITS {
            return fail(format!("{} vertices announced, at most {MAX_SPLITS} possible", info.vertices));
        }
        let mut local = Local::new(self, chunk);
        let mut decoder = Decoder::new(payload);
        code_chunk(&mut decoder, self, &mut local, chunk, Some(&announced), None)
            .map_err(|e| DecodeError::new(format!("chunk {chunk}"), e.why))?;
        if local.added() != (info.vertices, info.wedges, info.faces) {
            return fail(format!(
                "it adds {:?} vertices, wedges and faces; {:?} were announced",
                local.added(),
                (info.vertices, info.wedges, info.faces)
            ));
        }
        Ok(local.into_delta(chunk, info.parents.clone()))
    }
}

/// Encodes a chunk against the mesh to which all coarser levels are applied.
pub(crate) fn encode(
    mesh: &ActiveMesh,
    chunk: u32,
    parents: Vec<u32>,
    source: Source<'_>,
) -> Result<Encoded, DecodeError> {
    let mut local = Local::new(mesh, chunk);
    let mut encoder = Encoder::default();
    let mut names = Names::default();
    code_chunk(&mut encoder, mesh, &mut local, chunk, None, Some((&source, &mut names)))?;
    let (v, w, f) = local.added();
    let tail = |list: &[u32], count: u32| list[list.len() - count as usize..].to_vec();
    // Births come before the gathered region; everything else new comes after it.
    let births = source.plan.births.len();
    let mut vertices = names.vertices[..births].to_vec();
    vertices.extend(tail(&names.vertices, v - births as u32));
    Ok(Encoded {
        bytes: encoder.finish(),
        vertices,
        wedges: tail(&names.wedges, w),
        faces: tail(&names.faces, f),
        delta: local.into_delta(chunk, parents),
    })
}

fn code_chunk<C: Coder>(
    coder: &mut C,
    mesh: &ActiveMesh,
    local: &mut Local<'_>,
    chunk: u32,
    announced: Option<&Announced>,
    mut source: Option<(&Source<'_>, &mut Names)>,
) -> Result<(), DecodeError> {
    let mut model = Model::default();
    let bits = Bits { position: mesh.grid.bits, uv: mesh.uv_grid.bits, materials: mesh.indices.len() as u16 };
    code_births(coder, &mut model, local, bits.position, announced, &mut source)?;
    code_region(coder, &mut model, mesh, local, chunk, &mut source)?;
    let mut flags = 0_u64;
    let mut round = 0;
    loop {
        let wanted = source.as_ref().and_then(|(s, _)| s.plan.rounds.get(round));
        if !coder.bit(&mut model.more_rounds, wanted.is_some()) {
            return coder.check();
        }
        flags += local.vertices.len() as u64;
        if flags > MAX_FLAGS {
            return Err(DecodeError::new("chunk", "too many rounds"));
        }
        let before = local.added().0;
        code_round(coder, &mut model, local, bits, announced, round, &mut source)?;
        if local.added().0 == before {
            return Err(DecodeError::new("chunk", "a round without a split"));
        }
        round += 1;
    }
}

/// Vertices that start without faces: positions relative to one another.
fn code_births<C: Coder>(
    coder: &mut C,
    model: &mut Model,
    local: &mut Local<'_>,
    bits: u8,
    announced: Option<&Announced>,
    source: &mut Option<(&Source<'_>, &mut Names)>,
) -> Result<(), DecodeError> {
    let births = model.births.code(coder, source.as_ref().map_or(0, |(s, _)| s.plan.births.len() as u32));
    if announced.is_some_and(|a| births > a.vertices) {
        return Err(DecodeError::new("chunk", "more vertices appear than were announced"));
    }
    let mut previous = [1 << (bits - 1); 3];
    for i in 0..births as usize {
        let actual = source.as_ref().map(|(s, _)| s.mesh.positions[s.plan.births[i] as usize]);
        for axis in 0..3 {
            let residual = actual.map_or(0, |p| p[axis] - previous[axis]);
            previous[axis] = previous[axis].wrapping_add(model.birth_axis[axis].code(coder, residual));
            if previous[axis] < 0 || previous[axis] >= 1 << bits {
                return Err(DecodeError::new("chunk", "a position is off the grid"));
            }
        }
        local.add_vertex(previous, None);
        if let Some((s, names)) = source {
            names.vertex(s.plan.births[i]);
        }
        coder.check()?;
    }
    Ok(())
}

/// Seeds, and from each the interior vertices that it reaches.
fn code_region<C: Coder>(
    coder: &mut C,
    model: &mut Model,
    mesh: &ActiveMesh,
    local: &mut Local<'_>,
    chunk: u32,
    source: &mut Option<(&Source<'_>, &mut Names)>,
) -> Result<(), DecodeError> {
    loop {
        let next = source.as_ref().and_then(|(s, names)| {
            s.plan
                .needed
                .iter()
                .find(|v| !names.local_vertex.contains_key(v))
                .map(|&v| s.slot_of_vertex[v as usize])
        });
        if !coder.bit(&mut model.more_seeds, next.is_some()) {
            return coder.check();
        }
        // The origin counts back from this chunk; the base mesh is origin 0.
        let want = next.map_or(Id { origin: 0, index: 0 }, |slot| mesh.vertex_id(slot));
        let back = model.seed_origin.code(coder, chunk - want.origin);
        let place = chunk.checked_sub(back).and_then(|origin| Some((origin, mesh.place(origin)?)));
        let Some((origin, place)) = place else {
            return Err(DecodeError::new("chunk", "a seed lies in a chunk that is not applied"));
        };
        let number = index(coder, place.vertices.len(), want.index as usize, "chunk: seed")?;
        let seed = mesh.vertex_slot(Id { origin, index: number as u32 });
        let mut previous = 0_usize;
        local.explore(seed, &mut |slot| {
            let want = source.as_ref().is_some_and(|(s, _)| (s.interior)(s.vertex_by_slot[slot as usize]));
            let inside = coder.bit(&mut model.interior[previous], want);
            previous = (previous << 1 | usize::from(inside)) & 3;
            inside
        })?;
        coder.check()?;
        if let Some((s, names)) = source {
            name_gathered(s, names, mesh, local);
        }
    }
}

/// Gives the builder's names to what was gathered since the last call.
fn name_gathered(source: &Source<'_>, names: &mut Names, mesh: &ActiveMesh, local: &Local<'_>) {
    for v in &local.vertices[names.vertices.len()..] {
        names.vertex(source.vertex_by_slot[mesh.vertex_slot(v.id) as usize]);
    }
    for w in &local.wedges[names.wedges.len()..] {
        names.wedge(source.wedge_by_slot[mesh.wedge_slot(w.id) as usize]);
    }
    for f in &local.faces[names.faces.len()..] {
        names.faces.push(source.face_by_slot[mesh.face_slot(f.id()) as usize]);
    }
}

fn code_round<C: Coder>(
    coder: &mut C,
    model: &mut Model,
    local: &mut Local<'_>,
    bits: Bits,
    announced: Option<&Announced>,
    round: usize,
    source: &mut Option<(&Source<'_>, &mut Names)>,
) -> Result<(), DecodeError> {
    let count = local.vertices.len() as u32;
    let order: Vec<u32> = (0..count).filter(|&v| local.vertices[v as usize].interior).collect();
    let mut total = 0.0;
    for &v in &order {
        total += local.star_area(v);
    }
    let mean = total / order.len().max(1) as f64;
    let mut blocked = vec![false; count as usize];
    for v in order {
        if blocked[v as usize] {
            continue;
        }
        let context = flag_context(local, v, mean);
        let split =
            source.as_ref().and_then(|(s, names)| s.plan.rounds.get(round)?.get(&names.vertices[v as usize]));
        if !coder.bit(&mut model.flags[context], split.is_some()) {
            continue;
        }
        // Splits of one round share no face, so no neighbour of v splits in it.
        for spoke in local.star(v) {
            for ring in [spoke.a, spoke.b] {
                if let Some(mark) = blocked.get_mut(ring as usize) {
                    *mark = true;
                }
            }
        }
        let wish = match (source.as_mut(), split) {
            (Some((s, names)), Some(split)) => Some(Wish {
                split,
                position: s.mesh.positions[split.vertex as usize],
                wedges: s.wedges,
                materials: s.materials,
                names,
            }),
            _ => None,
        };
        code_split(coder, model, local, bits, v, wish)?;
        if let Some(a) = announced {
            let (vertices, wedges, faces) = local.added();
            if vertices > a.vertices || wedges > a.wedges || faces > a.faces {
                return Err(DecodeError::new("chunk", "it adds more than was announced"));
            }
        }
    }
    Ok(())
}

/// Context of a split flag: small stars of low valence seldom split.
fn flag_context(local: &mut Local<'_>, v: u32, mean: f64) -> usize {
    let area = local.star_area(v);
    let size = [0.25, 0.5, 1.0, 2.0, 4.0].iter().filter(|&&limit| area >= limit * mean).count();
    let valence = match local.valence(v) {
        0..=5 => 0,
        6 => 1,
        7 => 2,
        _ => 3,
    };
    (size * 4 + valence).min(FLAG_CONTEXTS - 1)
}
