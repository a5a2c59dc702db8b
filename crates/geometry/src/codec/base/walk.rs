//! The traversal over gates and faces, shared by encoder, decoder and training.

use std::collections::{HashMap, VecDeque};

use crate::asset::base::MAX_BASE_FACES;
use crate::codec::base::border::Border;
use crate::codec::base::mesh::{BaseFormat, BaseMesh};
use crate::codec::base::position_candidates::PositionCandidates;
use crate::codec::base::repeats::Repeats;
use crate::codec::base::target::TargetMesh;
use crate::codec::base::uv_candidates::UvCandidates;
use crate::codec::model::{BASE_GATE, BASE_MATERIAL, BASE_MORE, BASE_PART, BASE_SAME_MATERIAL};
use crate::codec::part::code_part;
use crate::codec::skin::{ExpectedSkin, code_skin};
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::integer;
use crate::error::DecodeError;
use crate::mesh::vec3::Vec3;
use crate::mesh::{Face, corner};
use crate::numbers::id32;

/// State of the traversal, with the mesh so far.
pub(super) struct Walk<'a, C> {
    /// Writes, reads or records symbols.
    pub(super) coder: &'a mut C,
    /// The mesh to encode; `None` in a decoder.
    pub(super) target: Option<TargetMesh<'a>>,
    pub(super) format: BaseFormat,
    /// Most elements that the input's length allows.
    max_elements: u64,
    /// Whether the candidate to predict from is coded; otherwise the best-ranked one is used.
    pub(super) choosing: bool,
    pub(super) mesh: BaseMesh,
    pub(super) wedges_of: Vec<Vec<u32>>,
    /// Gates not yet visited.
    queue: VecDeque<Gate>,
    /// Part of the component that began last.
    last_part: u32,
    /// Directed edges with a face, and the face.
    pub(super) edges: HashMap<(u32, u32), u32>,
    pub(super) border: Border,
    pub(super) repeats: Repeats,
    pub(super) position_candidates: PositionCandidates,
    /// Of each set of texture coordinates.
    pub(super) uv_candidates: [UvCandidates; 2],
}

/// An edge at which a face may be attached: a face and the corner that starts the edge.
#[derive(Clone, Copy)]
pub(super) struct Gate {
    pub(super) face: u32,
    pub(super) k: usize,
}

/// Known corners of the face being coded: all vertices come before the first wedge.
#[derive(Clone, Copy, Default)]
pub(super) struct Corners {
    pub(super) gate: Option<Gate>,
    /// Wedges of the adjacent face at the gate, for the first two corners.
    pub(super) across: [Option<u32>; 3],
    pub(super) vertices: [u32; 3],
    pub(super) wedges: [u32; 3],
    /// The next corner to code, first of vertices, then of wedges.
    pub(super) next: usize,
}

impl<'a, C: Coder> Walk<'a, C> {
    pub(super) fn new(coder: &'a mut C, format: BaseFormat, max_elements: u64, choosing: bool) -> Self {
        Self {
            coder,
            target: None,
            format,
            max_elements,
            choosing,
            mesh: BaseMesh::default(),
            wedges_of: Vec::new(),
            queue: VecDeque::new(),
            last_part: 0,
            edges: HashMap::new(),
            border: Border::default(),
            repeats: Repeats::default(),
            position_candidates: PositionCandidates::new(format.bits),
            uv_candidates: [0, 1].map(|set| UvCandidates::new(format.kinds.uv_bits_of_set(set))),
        }
    }

    pub(super) fn run(&mut self) -> Result<(), DecodeError> {
        self.choosing = self.coder.raw(1, self.choosing.into()) == 1;
        loop {
            let Some(gate) = self.queue.pop_front() else {
                let seed = self.target.as_mut().and_then(TargetMesh::seed);
                if !self.coder.bit(BASE_MORE, seed.is_some()) {
                    return self.coder.check();
                }
                self.repeats.begin(self.mesh.positions.len(), self.mesh.wedges.len());
                self.face(None, seed)?;
                continue;
            };
            let v = self.corners(gate.face);
            let (a, b) = (v[gate.k], v[corner::next(gate.k)]);
            if self.edges.contains_key(&(b, a)) {
                continue;
            }
            let face = self.target.as_mut().and_then(|w| w.at_gate(b, a));
            if self.flag(BASE_GATE, face.is_some()) {
                self.face(Some(gate), face)?;
            }
        }
    }

    /// Codes one face. At a gate its first two corners are the gate's, reversed.
    fn face(&mut self, gate: Option<Gate>, want: Option<(u32, [u32; 3])>) -> Result<(), DecodeError> {
        if self.mesh.faces.len() >= MAX_BASE_FACES {
            return Err(DecodeError::new("base mesh", format!("more than {MAX_BASE_FACES} faces")));
        }
        if self.mesh.elements() >= self.max_elements {
            return Err(DecodeError::new("base mesh", "more faces than its bytes allow"));
        }
        let across = gate.map_or([None; 3], |gate| {
            let wedges = self.mesh.faces[gate.face as usize].wedges;
            [Some(wedges[corner::next(gate.k)]), Some(wedges[gate.k]), None]
        });
        let mut corners = Corners { gate, across, ..Corners::default() };
        for (i, across) in across.into_iter().enumerate() {
            corners.next = i;
            let vertex = match across {
                Some(wedge) => self.mesh.wedges[wedge as usize].vertex,
                None => {
                    let wanted = want.map(|w| w.1[i]);
                    let vertex = self.vertex(&corners, wanted)?;
                    let known = corners.vertices[..i].first().copied();
                    self.part(vertex, known, wanted)?;
                    self.skin(vertex, &corners.vertices[..i], wanted)?;
                    vertex
                }
            };
            if corners.vertices[..i].contains(&vertex) {
                return Err(DecodeError::new("base mesh", "a face uses a vertex twice"));
            }
            corners.vertices[i] = vertex;
        }
        for i in 0..3 {
            corners.next = i;
            corners.wedges[i] = self.wedge(&corners, want.map(|w| w.1[i]))?;
        }
        let places = corners.vertices.map(|v| self.place(v));
        self.uv_candidates.iter_mut().for_each(|set| set.follow(places, corners.wedges));
        let material = self.material(gate, want.map(|w| w.0))?;
        let face = id32(self.mesh.faces.len());
        self.mesh.faces.push(Face { wedges: corners.wedges, material });
        if let (Some(wanted), Some((name, _))) = (&mut self.target, want) {
            wanted.names.faces.push(name);
        }
        for k in 0..3 {
            let (a, b) = (corners.vertices[k], corners.vertices[corner::next(k)]);
            self.border.edge(a, b, self.edges.contains_key(&(b, a)));
            self.edges.insert((a, b), face);
            self.queue.push_back(Gate { face, k });
        }
        self.coder.check()
    }

    /// Codes the part of a vertex if it is new: that of a known corner of the face, else close to the last.
    fn part(&mut self, vertex: u32, known: Option<u32>, want: Option<u32>) -> Result<(), DecodeError> {
        if self.format.parts < 2 || self.mesh.parts.len() > vertex as usize {
            return Ok(());
        }
        let part = match known {
            Some(corner) => self.mesh.parts[corner as usize],
            None => {
                let wanted = match (&self.target, want) {
                    (Some(target), Some(wedge)) => target.part(wedge),
                    _ => 0,
                };
                self.last_part = code_part(self.coder, BASE_PART, self.last_part, wanted, self.format.parts)
                    .ok_or_else(|| DecodeError::new("base mesh", "a part is out of range"))?;
                self.last_part
            }
        };
        self.mesh.parts.push(part);
        Ok(())
    }

    /// Codes the skin of a vertex if it is new, expected from the known corners of the face, else from the last.
    fn skin(&mut self, vertex: u32, known: &[u32], want: Option<u32>) -> Result<(), DecodeError> {
        if !self.format.kinds.skins || self.mesh.skins.len() > vertex as usize {
            return Ok(());
        }
        let of = |corner: u32| self.mesh.skins.get(corner as usize).copied().unwrap_or_default();
        let (first, others) = match known {
            [first, others @ ..] => (of(*first), others),
            [] => (self.mesh.skins.last().copied().unwrap_or_default(), known),
        };
        let mut expected = ExpectedSkin::near(first);
        others.iter().for_each(|&corner| expected.add(of(corner)));
        let wanted = match (&self.target, want) {
            (Some(target), Some(wedge)) => Some(target.skin(wedge)),
            _ => None,
        };
        let skin = code_skin(self.coder, &expected, wanted)?;
        self.mesh.skins.push(skin);
        Ok(())
    }

    fn material(&mut self, gate: Option<Gate>, want: Option<u32>) -> Result<u16, DecodeError> {
        let near = gate.map_or(0, |g| self.mesh.faces[g.face as usize].material);
        let actual = match (&self.target, want) {
            (Some(wanted), Some(face)) => wanted.material(face),
            _ => near,
        };
        let mut material = near;
        if self.format.materials > 1 && !self.coder.bit(BASE_SAME_MATERIAL, actual == near) {
            let got = integer(self.coder, BASE_MATERIAL, u32::from(actual));
            material = u16::try_from(got).unwrap_or(u16::MAX);
        }
        if material >= self.format.materials.max(1) {
            return Err(DecodeError::new(
                "base mesh",
                format!("material {material} of {}", self.format.materials),
            ));
        }
        Ok(material)
    }

    /// Codes a decision that earlier components may predict.
    pub(super) fn flag(&mut self, context: usize, value: bool) -> bool {
        let got = self.coder.bit(context + self.repeats.state(context), value);
        self.repeats.follow(context, got);
        got
    }

    pub(super) fn place(&self, vertex: u32) -> Vec3 {
        self.mesh.positions[vertex as usize].map(f64::from)
    }

    pub(super) fn corners(&self, face: u32) -> [u32; 3] {
        self.mesh.faces[face as usize].wedges.map(|w| self.mesh.wedges[w as usize].vertex)
    }
}
