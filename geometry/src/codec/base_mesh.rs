//! The base mesh: a traversal over gates (directed edges), after the idea of Edgebreaker (Rossignac,
//! 1999) but for any triangle soup: what a gate does not reach starts anew as a seed face.

use std::collections::{HashMap, HashSet, VecDeque};

use crate::asset::base::MAX_BASE_FACES;
use crate::codec::attributes::{Expected, code_attributes};
use crate::codec::model::{
    BASE_AXIS, BASE_GATE, BASE_MATERIAL, BASE_MORE, BASE_NEW_VERTEX, BASE_NEW_WEDGE, BASE_SAME_MATERIAL,
    BASE_SAME_WEDGE, STREAMS, contexts,
};
use crate::codec::residual::Recent;
use crate::entropy::Codec;
use crate::entropy::ceiling::{least_bytes, most_elements};
use crate::entropy::mute::Mute;
use crate::entropy::plain_coder::{PlainDecoder, PlainEncoder};
use crate::entropy::range_coder::{Coder, Decoder, Encoder};
use crate::entropy::symbols::{INTEGER_CONTEXTS, index, integer, signed};
use crate::error::DecodeError;
use crate::mesh::corner;
use crate::mesh::{Face, Kinds, Wedge};
use crate::numbers::id32;

/// A small mesh in the order of the traversal.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct BaseMesh {
    pub(crate) positions: Vec<[i32; 3]>,
    pub(crate) wedges: Vec<Wedge>,
    pub(crate) faces: Vec<Face>,
}

impl BaseMesh {
    /// Vertices, wedges and faces.
    fn elements(&self) -> u64 {
        (self.positions.len() + self.wedges.len() + self.faces.len()) as u64
    }
}

/// A base mesh in the order of the traversal, and where its elements come from in the mesh given.
pub(crate) struct OrderedBase {
    pub(crate) mesh: BaseMesh,
    pub(crate) vertices: Vec<u32>,
    pub(crate) wedges: Vec<u32>,
    pub(crate) faces: Vec<u32>,
}

/// What a base mesh's symbols depend on besides the mesh.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BaseFormat {
    /// Bits per axis of positions.
    pub(crate) bits: u8,
    pub(crate) kinds: Kinds,
    /// Materials that faces may name.
    pub(crate) materials: u16,
}

/// Brings a mesh into the order of the traversal. Fails as [`encode`] does.
pub(crate) fn ordered(mesh: &BaseMesh, format: BaseFormat) -> Result<OrderedBase, DecodeError> {
    encode_with(&mut Mute, mesh, format)
}

/// Encodes a mesh, given in any order. Fails on more than [`MAX_BASE_FACES`] faces and on faces with a
/// repeated vertex.
pub(crate) fn encode(mesh: &BaseMesh, codec: Codec, format: BaseFormat) -> Result<Vec<u8>, DecodeError> {
    Ok(match codec {
        Codec::Range => {
            let mut encoder = Encoder::new(contexts());
            let said = encode_with(&mut encoder, mesh, format)?;
            encoder.finish(least_bytes(said.mesh.elements()))
        }
        Codec::Plain => {
            let mut encoder = PlainEncoder::new(&STREAMS);
            let said = encode_with(&mut encoder, mesh, format)?;
            encoder.finish(least_bytes(said.mesh.elements()))
        }
    })
}

/// Says a mesh to any coder.
pub(crate) fn encode_with<C: Coder>(
    coder: &mut C,
    mesh: &BaseMesh,
    format: BaseFormat,
) -> Result<OrderedBase, DecodeError> {
    let mut walk = Walk::new(coder, format, u64::MAX);
    walk.wanted = Some(WantedMesh::new(mesh));
    walk.run()?;
    let (vertices, wedges, faces) =
        walk.wanted.map_or_else(Default::default, |wanted| (wanted.vertices, wanted.wedges, wanted.faces));
    Ok(OrderedBase { mesh: walk.mesh, vertices, wedges, faces })
}

/// Decodes a mesh.
pub(crate) fn decode(bytes: &[u8], codec: Codec, format: BaseFormat) -> Result<BaseMesh, DecodeError> {
    let most = most_elements(bytes.len());
    match codec {
        Codec::Range => {
            let mut decoder = Decoder::new(contexts(), bytes);
            let mesh = decode_with(&mut decoder, format, most)?;
            decoder.end(least_bytes(mesh.elements()))?;
            Ok(mesh)
        }
        Codec::Plain => {
            let mut decoder = PlainDecoder::new(&STREAMS, bytes)?;
            let mesh = decode_with(&mut decoder, format, most)?;
            decoder.end(least_bytes(mesh.elements()))?;
            Ok(mesh)
        }
    }
}

fn decode_with<C: Coder>(
    coder: &mut C,
    format: BaseFormat,
    most_elements: u64,
) -> Result<BaseMesh, DecodeError> {
    let mut walk = Walk::new(coder, format, most_elements);
    walk.run()?;
    Ok(walk.mesh)
}

/// What the encoder wants said: the mesh, and the names of what was said so far.
struct WantedMesh<'a> {
    mesh: &'a BaseMesh,
    /// Faces by directed edge (vertices of `mesh`), as (face, corner that starts the edge).
    edges: HashMap<(u32, u32), Vec<(u32, u8)>>,
    done: Vec<bool>,
    next_seed: usize,
    local_vertex: HashMap<u32, u32>,
    local_wedge: HashMap<u32, u32>,
    vertices: Vec<u32>,
    wedges: Vec<u32>,
    faces: Vec<u32>,
}

impl<'a> WantedMesh<'a> {
    fn new(mesh: &'a BaseMesh) -> Self {
        let mut edges: HashMap<(u32, u32), Vec<(u32, u8)>> = HashMap::new();
        for (f, face) in mesh.faces.iter().enumerate() {
            let v = face.wedges.map(|w| mesh.wedges[w as usize].vertex);
            for (k, corner) in (0..3).zip(0_u8..) {
                edges.entry((v[k], v[corner::next(k)])).or_default().push((id32(f), corner));
            }
        }
        Self {
            mesh,
            edges,
            done: vec![false; mesh.faces.len()],
            next_seed: 0,
            local_vertex: HashMap::new(),
            local_wedge: HashMap::new(),
            vertices: Vec::new(),
            wedges: Vec::new(),
            faces: Vec::new(),
        }
    }

    /// The next face for a gate, as its wedges from the gate's edge on.
    fn at_gate(&mut self, a: u32, b: u32) -> Option<(u32, [u32; 3])> {
        let edge = (self.vertices[a as usize], self.vertices[b as usize]);
        let (face, k) = *self.edges.get(&edge)?.iter().find(|(f, _)| !self.done[*f as usize])?;
        Some(self.take(face, usize::from(k)))
    }

    fn seed(&mut self) -> Option<(u32, [u32; 3])> {
        while self.next_seed < self.done.len() && self.done[self.next_seed] {
            self.next_seed += 1;
        }
        (self.next_seed < self.done.len()).then(|| self.take(id32(self.next_seed), 0))
    }

    fn take(&mut self, face: u32, k: usize) -> (u32, [u32; 3]) {
        self.done[face as usize] = true;
        let w = self.mesh.faces[face as usize].wedges;
        (face, [w[k], w[corner::next(k)], w[corner::previous(k)]])
    }

    fn vertex_of(&self, wedge: u32) -> u32 {
        self.mesh.wedges[wedge as usize].vertex
    }
}

/// The traversal, with the mesh so far.
struct Walk<'a, C> {
    /// Writes, reads or records symbols.
    coder: &'a mut C,
    /// What an encoder wants said; a decoder has none.
    wanted: Option<WantedMesh<'a>>,
    format: BaseFormat,
    /// What its bytes can justify.
    most_elements: u64,
    mesh: BaseMesh,
    wedges_of: Vec<Vec<u32>>,
    /// Where faces may grow yet.
    queue: VecDeque<Gate>,
    /// Directed edges that have a face.
    edges: HashSet<(u32, u32)>,
}

/// Where a face grows from: a face there, and its corners along the shared edge and opposite.
#[derive(Clone, Copy)]
struct Gate {
    face: u32,
    k: usize,
}

impl<'a, C: Coder> Walk<'a, C> {
    fn new(coder: &'a mut C, format: BaseFormat, most_elements: u64) -> Self {
        Self {
            coder,
            wanted: None,
            format,
            most_elements,
            mesh: BaseMesh::default(),
            wedges_of: Vec::new(),
            queue: VecDeque::new(),
            edges: HashSet::new(),
        }
    }

    fn run(&mut self) -> Result<(), DecodeError> {
        loop {
            let Some(gate) = self.queue.pop_front() else {
                let seed = self.wanted.as_mut().and_then(WantedMesh::seed);
                if !self.coder.bit(BASE_MORE, seed.is_some()) {
                    return self.coder.check();
                }
                self.face(None, seed)?;
                continue;
            };
            let v = self.corners(gate.face);
            let (a, b) = (v[gate.k], v[corner::next(gate.k)]);
            if self.edges.contains(&(b, a)) {
                continue;
            }
            let face = self.wanted.as_mut().and_then(|w| w.at_gate(b, a));
            if self.coder.bit(BASE_GATE, face.is_some()) {
                self.face(Some(gate), face)?;
            }
        }
    }

    fn corners(&self, face: u32) -> [u32; 3] {
        self.mesh.faces[face as usize].wedges.map(|w| self.mesh.wedges[w as usize].vertex)
    }

    /// One face: at a gate its first two corners are the gate's, reversed.
    fn face(&mut self, gate: Option<Gate>, want: Option<(u32, [u32; 3])>) -> Result<(), DecodeError> {
        if self.mesh.faces.len() >= MAX_BASE_FACES {
            return Err(DecodeError::new("base mesh", format!("more than {MAX_BASE_FACES} faces")));
        }
        if self.mesh.elements() >= self.most_elements {
            return Err(DecodeError::new("base mesh", "more faces than its bytes can be"));
        }
        let mut vertices = [0; 3];
        let mut wedges = [0; 3];
        for i in 0..3 {
            let builder = want.map(|w| w.1[i]);
            let known = match gate {
                Some(gate) if i < 2 => {
                    let k = if i == 0 { corner::next(gate.k) } else { gate.k };
                    let wedge = self.mesh.faces[gate.face as usize].wedges[k];
                    Some((self.mesh.wedges[wedge as usize].vertex, wedge))
                }
                _ => None,
            };
            vertices[i] = match known {
                Some((vertex, _)) => vertex,
                None => self.vertex(gate, &vertices[..i], builder)?,
            };
            if vertices[..i].contains(&vertices[i]) {
                return Err(DecodeError::new("base mesh", "a face uses a vertex twice"));
            }
            let uv_guess = known.map(|k| k.1).or((i > 0).then(|| wedges[i - 1]));
            wedges[i] = self.wedge(vertices[i], known.map(|k| k.1), uv_guess, builder)?;
        }
        let near = gate.map_or(0, |g| self.mesh.faces[g.face as usize].material);
        let actual = match (&self.wanted, want) {
            (Some(g), Some((face, _))) => g.mesh.faces[face as usize].material,
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
        let face = id32(self.mesh.faces.len());
        self.mesh.faces.push(Face { wedges, material });
        if let (Some(g), Some((builder, _))) = (&mut self.wanted, want) {
            g.faces.push(builder);
        }
        for k in 0..3 {
            self.edges.insert((vertices[k], vertices[corner::next(k)]));
            self.queue.push_back(Gate { face, k });
        }
        self.coder.check()
    }

    /// A corner's vertex; `so_far` are those of the corners before.
    fn vertex(
        &mut self,
        gate: Option<Gate>,
        so_far: &[u32],
        builder: Option<u32>,
    ) -> Result<u32, DecodeError> {
        let count = self.mesh.positions.len();
        let wanted = match (&self.wanted, builder) {
            (Some(g), Some(w)) => g.local_vertex.get(&g.vertex_of(w)).copied(),
            _ => None,
        };
        let context = usize::from(gate.is_some());
        if count > 0 && !self.coder.bit(BASE_NEW_VERTEX + context, wanted.is_none()) {
            return index(self.coder, count, wanted.unwrap_or(0) as usize, "base mesh: vertex").map(id32);
        }
        let at = |v: u32| self.mesh.positions[v as usize];
        let top = (1 << self.format.bits) - 1;
        let guess = match gate {
            // Parallelogram rule (Touma and Gotsman, 1998).
            Some(gate) => {
                let v = self.corners(gate.face);
                let (a, b, c) = (at(v[gate.k]), at(v[corner::next(gate.k)]), at(v[corner::previous(gate.k)]));
                [0, 1, 2].map(|i| (a[i] + b[i] - c[i]).clamp(0, top))
            }
            None if !so_far.is_empty() => at(so_far[so_far.len() - 1]),
            None => self.mesh.positions.last().copied().unwrap_or([1 << (self.format.bits - 1); 3]),
        };
        let actual = match (&self.wanted, builder) {
            (Some(g), Some(w)) => Some(g.mesh.positions[g.vertex_of(w) as usize]),
            _ => None,
        };
        let mut position = [0; 3];
        for axis in 0..3 {
            let residual = actual.map_or(0, |p| p[axis] - guess[axis]);
            position[axis] = guess[axis].wrapping_add(signed(
                self.coder,
                BASE_AXIS + (context * 3 + axis) * INTEGER_CONTEXTS,
                residual,
            ));
            if !(0..=top).contains(&position[axis]) {
                return Err(DecodeError::new("base mesh", "a position is off the grid"));
            }
        }
        self.mesh.positions.push(position);
        self.wedges_of.push(Vec::new());
        if let (Some(g), Some(w)) = (&mut self.wanted, builder) {
            let vertex = g.vertex_of(w);
            g.local_vertex.insert(vertex, id32(count));
            g.vertices.push(vertex);
        }
        Ok(id32(count))
    }

    /// A corner's wedge, perhaps `guess`; `near` is a wedge near by.
    fn wedge(
        &mut self,
        vertex: u32,
        guess: Option<u32>,
        near: Option<u32>,
        builder: Option<u32>,
    ) -> Result<u32, DecodeError> {
        let own = &self.wedges_of[vertex as usize];
        let want = match (&self.wanted, builder) {
            (Some(g), Some(w)) => g.local_wedge.get(&w).copied(),
            _ => None,
        };
        if let Some(guess) = guess.or(own.first().copied()) {
            if self.coder.bit(BASE_SAME_WEDGE, want == Some(guess)) {
                return Ok(guess);
            }
            if !self.coder.bit(BASE_NEW_WEDGE, want.is_none()) {
                let place = own.iter().position(|&w| Some(w) == want).unwrap_or(0);
                return Ok(own[index(self.coder, own.len(), place, "base mesh: wedge")?]);
            }
        }
        let actual = match (&self.wanted, builder) {
            (Some(g), Some(w)) => Some(g.mesh.wedges[w as usize]),
            _ => None,
        };
        let near = near.map(|w| self.mesh.wedges[w as usize].attributes);
        let uv = near.map_or([0; 2], |w| w.uv);
        let expected = Expected { uv, uv_size: None, near, normal: [0.0; 3], first: own.is_empty() };
        let actual = actual.map(|w| w.attributes);
        let attributes =
            code_attributes(self.coder, self.format.kinds, &mut Recent::default(), &expected, actual)?;
        let wedge = id32(self.mesh.wedges.len());
        self.mesh.wedges.push(Wedge { vertex, attributes });
        self.wedges_of[vertex as usize].push(wedge);
        if let (Some(g), Some(w)) = (&mut self.wanted, builder) {
            g.local_wedge.insert(w, wedge);
            g.wedges.push(w);
        }
        Ok(wedge)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Says yes wherever that makes the mesh grow.
    struct Greedy(Encoder);

    impl Coder for Greedy {
        fn bit(&mut self, context: usize, value: bool) -> bool {
            let grow = [BASE_MORE, BASE_GATE, BASE_NEW_VERTEX, BASE_NEW_VERTEX + 1].contains(&context);
            self.0.bit(context, grow || value)
        }
        fn mix<const N: usize>(&mut self, contexts: [usize; N], mixer: usize, value: bool) -> bool {
            self.0.mix(contexts, mixer, value)
        }
        fn raw(&mut self, bits: u32, value: u32) -> u32 {
            self.0.raw(bits, value)
        }
        fn check(&self) -> Result<(), DecodeError> {
            Ok(())
        }
    }

    #[test]
    fn a_million_faces_in_a_few_kilobytes_are_refused_before_they_are_there() {
        let mut greedy = Greedy(Encoder::new(contexts()));
        let format = BaseFormat { bits: 12, kinds: Kinds::default(), materials: 1 };
        let mut walk = Walk::new(&mut greedy, format, u64::MAX);
        assert!(walk.run().is_err());
        assert_eq!(walk.mesh.faces.len(), MAX_BASE_FACES);
        let bytes = greedy.0.finish(0);
        assert!(bytes.len() < MAX_BASE_FACES / 32, "{} bytes", bytes.len());
        let mut decoder = Decoder::new(contexts(), &bytes);
        let mut walk = Walk::new(&mut decoder, format, most_elements(bytes.len()));
        let why = walk.run().unwrap_err().to_string();
        assert!(why.contains("more faces than its bytes can be"), "{why}");
        assert!(walk.mesh.elements() <= most_elements(bytes.len()) + 6);
    }
}
