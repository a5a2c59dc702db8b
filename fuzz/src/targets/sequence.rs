//! Sequences of decoding, applying and undoing, in any order and from damaged payloads.

use lodestream_geometry::index::ChunkInfo;
use lodestream_geometry::refine::{ActiveMesh, ChunkDelta, Id, Origin, RefineError, Snapshot};

use super::asset::drawable;
use crate::fixtures::{self, Fixture};
use crate::input::Input;

/// Most operations of one input.
const MAX_OPERATIONS: usize = 48;

/// Operations on one asset, a few bytes each. After any of them: an error changes nothing, the mesh can be drawn, and
/// undoing everything restores the base mesh.
pub fn apply_undo(data: &[u8]) -> bool {
    let mut input = Input::new(data);
    let fixtures = fixtures::all();
    let mut player = Player::new(&fixtures[usize::from(input.u8()) % fixtures.len()]);
    for _ in 0..MAX_OPERATIONS {
        if input.is_empty() {
            break;
        }
        player.operate(&mut input);
    }
    let accepted = player.mesh.applied_count() > 0;
    drawable(&player.mesh);
    player.undo_all();
    accepted
}

struct Player<'a> {
    fixture: &'a Fixture,
    mesh: ActiveMesh,
    /// By chunk: the last applied delta, to be applied again or forged.
    deltas: Vec<Option<ChunkDelta>>,
    /// A snapshot of the mesh, if it has not changed since.
    state: Option<Snapshot>,
}

impl<'a> Player<'a> {
    fn new(fixture: &'a Fixture) -> Self {
        let chunks = fixture.before.len();
        Self { fixture, mesh: ActiveMesh::new(&fixture.asset.base), deltas: vec![None; chunks], state: None }
    }

    fn operate(&mut self, input: &mut Input<'_>) {
        let operation = input.u8();
        let chunk = input.choice(self.deltas.len());
        // To one of the chunk's truncation points, or to its end.
        let truncation_points = self.fixture.asset.infos[chunk].truncation_points.len();
        let truncation = (operation / 6).checked_sub(1).map(|s| s % (truncation_points as u8 + 1));
        let truncation = truncation.filter(|&s| usize::from(s) < truncation_points);
        match operation % 6 {
            0 => self.decode(chunk, chunk, truncation, |_| {}),
            1 => {
                let (at, value) = (input.u16(), input.u8());
                self.decode(chunk, chunk, truncation, |payload| {
                    let at = usize::from(at) % payload.len().max(1);
                    if let Some(byte) = payload.get_mut(at) {
                        *byte ^= value;
                    }
                });
            }
            // Another chunk's payload under this chunk's id, without parents.
            2 => self.decode(chunk, input.choice(self.deltas.len()), truncation, |_| {}),
            3 => self.undo(chunk),
            4 => {
                if let Some(delta) = self.deltas[chunk].clone() {
                    self.apply(delta);
                }
            }
            _ => {
                if let Some(mut delta) = self.deltas[chunk].clone() {
                    forge(&mut delta, input);
                    self.apply(delta);
                }
            }
        }
    }

    fn decode(
        &mut self,
        chunk: usize,
        source: usize,
        truncation: Option<u8>,
        damage: impl FnOnce(&mut Vec<u8>),
    ) {
        let mut info = self.fixture.asset.infos[source].clone();
        if source != chunk {
            info.parents.clear();
        }
        let mut payload = self.fixture.asset.chunks[source].clone();
        damage(&mut payload);
        if self.mesh.applied_truncation(chunk as u32).is_some() {
            self.raise(chunk, &info, truncation, &payload);
        } else if let Ok(delta) = self.mesh.decode_prefix(chunk as u32, &info, truncation, &payload) {
            self.apply(delta);
        }
    }

    fn raise(&mut self, chunk: usize, info: &ChunkInfo, truncation: Option<u8>, payload: &[u8]) {
        let before = self.state.take().unwrap_or_else(|| self.mesh.snapshot());
        let faces = self.mesh.face_count();
        match self.mesh.raise(chunk as u32, info, truncation, payload) {
            Ok(_) => assert_eq!(self.mesh.applied_truncation(chunk as u32), truncation),
            Err(_) => {
                assert!(self.mesh.snapshot() == before, "a refused raise left a trace");
                assert_eq!(self.mesh.face_count(), faces);
                self.state = Some(before);
            }
        }
    }

    fn apply(&mut self, delta: ChunkDelta) {
        let before = self.state.take().unwrap_or_else(|| self.mesh.snapshot());
        let chunk = delta.chunk as usize;
        match self.mesh.apply(&delta) {
            Ok(touched) => {
                let slots = self.mesh.wedge_slots();
                assert!(touched.wedges.iter().all(|&w| w < slots));
                self.deltas[chunk] = Some(delta);
            }
            Err(_) => {
                assert!(self.mesh.snapshot() == before, "a refused chunk left a trace");
                self.state = Some(before);
            }
        }
    }

    fn undo(&mut self, chunk: usize) {
        let before = self.state.take().unwrap_or_else(|| self.mesh.snapshot());
        let applied = self.mesh.is_applied(chunk as u32);
        match self.mesh.undo(chunk as u32) {
            Ok(_) => assert!(applied),
            Err(why) => {
                assert!(self.mesh.snapshot() == before, "a refused undo left a trace");
                let expected = match why {
                    RefineError::NotApplied(_) => !applied,
                    RefineError::HasChildren { .. } => applied,
                    _ => false,
                };
                assert!(expected, "{why}");
                self.state = Some(before);
            }
        }
    }

    /// Undoes chunks until none is applied.
    fn undo_all(&mut self) {
        while self.mesh.applied_count() > 0 {
            let before = self.mesh.applied_count();
            for chunk in (0..self.deltas.len()).rev() {
                if self.mesh.is_applied(chunk as u32) {
                    self.undo(chunk);
                }
            }
            assert!(self.mesh.applied_count() < before, "{before} chunks cannot be undone");
        }
        let base = ActiveMesh::new(&self.fixture.asset.base);
        assert!(self.mesh.snapshot() == base.snapshot(), "undoing everything did not give the base back");
        assert_eq!(self.mesh.face_count(), base.face_count());
        assert_eq!(self.mesh.vertex_count(), base.vertex_count());
        drawable(&self.mesh);
    }
}

/// Changes one reference or number of a delta.
fn forge(delta: &mut ChunkDelta, input: &mut Input<'_>) {
    let (what, at) = (input.u8(), usize::from(input.u8()));
    let id = Id { owner: u32::from(input.u8()), index: u32::from(input.u8()) };
    fn pick<T>(list: &mut [T], at: usize) -> Option<&mut T> {
        let count = list.len().max(1);
        list.get_mut(at % count)
    }
    match what % 10 {
        0 => pick(&mut delta.vertices, at).map_or((), |v| {
            v.origin = if id.owner == 255 { Origin::Part(id.index) } else { Origin::Split(id) }
        }),
        1 => pick(&mut delta.wedges, at).map_or((), |w| w.vertex = id),
        2 => pick(&mut delta.faces, at).map_or((), |f| f.wedges[at % 3] = id),
        3 => pick(&mut delta.repoints, at).map_or((), |r| r.face = id),
        4 => pick(&mut delta.repoints, at).map_or((), |r| r.from = id),
        5 => pick(&mut delta.repoints, at).map_or((), |r| r.to = id),
        6 => pick(&mut delta.repoints, at).map_or((), |r| r.corner = id.index as u8),
        7 => {
            if let Some(repoint) = pick(&mut delta.repoints, at).copied() {
                delta.repoints.push(repoint);
            }
        }
        8 => pick(&mut delta.faces, at).map_or((), |f| f.material = id.index as u16),
        _ => delta.parents.push(id.index),
    }
}
