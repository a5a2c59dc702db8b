//! Compares refined meshes with an independent reference: the input with the collapses of all chunks outside the cut
//! redone, finest level first, in the builder's ids. The decoder is not part of the reference.

use std::collections::BTreeMap;

use crate::asset::base::Base;
use crate::asset::index::ChunkInfo;
use crate::check::ancestor_closed_cut::{self, Member};
use crate::checkpoint::InMemoryCheckpoint;
use crate::collapse::NO_VERTEX;
use crate::common;
use crate::mesh::{QuantisedMesh, Wedge};
use crate::pool::{MonitoredPool, Serial, Silent};
use crate::prepare::encode::{EncodedRegion, Plan, encode_all};
use crate::prepare::{Hooks, build_base};
use crate::random::Random;
use crate::refine::{ActiveMesh, ChunkDelta, Id};
use crate::simplify::blocks::merged::Merged;
use crate::simplify::blocks::{in_blocks, simplify_blocks};
use crate::simplify::hierarchy::RegionChunk;
use crate::simplify::levels::{Levels, Simplified};
use crate::simplify::settings::Settings;
use crate::simplify::simplify_from;

/// Faces by the builder's ids: wedges, rotated so that the smallest comes first.
type Faces = BTreeMap<u32, [u32; 3]>;

/// Input of both sides, with the builder's id of each canonical id.
struct Case<'a> {
    mesh: &'a QuantisedMesh,
    simplified: Simplified<'a>,
    regions: Vec<RegionChunk>,
    infos: Vec<ChunkInfo>,
    payloads: Vec<Vec<u8>>,
    base: Base,
    deltas: Vec<ChunkDelta>,
    vertices: Vec<Vec<u32>>,
    wedges: Vec<Vec<u32>>,
    faces: Vec<Vec<u32>>,
}

impl<'a> Case<'a> {
    fn new(
        mesh: &'a QuantisedMesh,
        settings: &Settings,
        (checkpoint, merged): (&'a InMemoryCheckpoint, &'a mut Option<Merged>),
    ) -> Self {
        let mut pool = MonitoredPool::new(&Serial, &Silent, mesh.faces.len());
        let mut levels = Levels::new(checkpoint);
        *merged = in_blocks(mesh, settings)
            .then(|| simplify_blocks(mesh, settings, &mut pool, &mut levels).unwrap());
        let simplified = simplify_from(mesh, merged.as_ref(), settings, &mut pool, levels).unwrap();
        let materials = mesh.faces.iter().map(|f| f.material).max().unwrap_or(0) + 1;
        let (base, first) = build_base(mesh, &simplified, materials, settings.codec).unwrap();
        let (mut vertices, mut wedges, mut faces) =
            (vec![first.vertices.clone()], vec![first.wedges.clone()], vec![first.faces.clone()]);
        let (mut regions, mut infos, mut payloads, mut deltas) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut keep = |EncodedRegion { level, region, parents, encoded: e }: EncodedRegion| {
            infos.push(ChunkInfo {
                parents,
                level: base.level_count - level as u8,
                vertices: e.vertices.len() as u32,
                wedges: e.wedges.len() as u32,
                faces: e.faces.len() as u32,
                truncation_points: e.truncation_points.iter().map(|s| s.truncation(0.0)).collect(),
                ..ChunkInfo::default()
            });
            regions.push(region);
            payloads.push(e.bytes);
            deltas.push(e.delta);
            vertices.push(e.vertices);
            wedges.push(e.wedges);
            faces.push(e.faces);
        };
        let plan = Plan { mesh, simplified: &simplified, base: &base };
        encode_all(&plan, first, &pool, &Hooks::new(&Serial, &Silent), &mut keep).unwrap();
        Self { mesh, simplified, regions, infos, payloads, base, deltas, vertices, wedges, faces }
    }

    /// All chunks, whole.
    fn all_chunks(&self) -> Vec<Member> {
        (0..self.infos.len() as u32).map(|chunk| Member { chunk, truncation: None }).collect()
    }

    /// The input after the collapses of all chunks outside `set`, and those beyond the truncation points of its
    /// members.
    fn collapsed(&self, set: &[Member]) -> Faces {
        let all_wedges = &self.simplified.wedges;
        let vertex = |w: u32| all_wedges.get(w).vertex;
        let mut faces: BTreeMap<u32, [u32; 3]> =
            self.mesh.faces.iter().enumerate().map(|(i, f)| (i as u32, f.wedges)).collect();
        let mut around: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (&face, wedges) in &faces {
            for &w in wedges {
                around.entry(vertex(w)).or_default().push(face);
            }
        }
        // Ids ascend from coarse to fine, so the finest level is last.
        for id in (0..self.regions.len()).rev() {
            let records = &self.regions[id].records;
            let left = match set.binary_search_by_key(&(id as u32), |m| m.chunk).map(|at| set[at].truncation)
            {
                Ok(Some(truncation)) => {
                    records.truncation_points[records.coded_truncation_points()][usize::from(truncation)]
                        as usize
                }
                Ok(None) => 0,
                Err(_) => records.collapses.len(),
            };
            for i in 0..left {
                let (collapse, moved_positions, removed) = records.parts(i);
                let (u, t) = (collapse.removed, collapse.target);
                let star: Vec<u32> = around
                    .remove(&u)
                    .unwrap_or_default()
                    .into_iter()
                    .filter(|f| faces.get(f).is_some_and(|w| w.iter().any(|&w| vertex(w) == u)))
                    .collect();
                if t == NO_VERTEX {
                    assert!(star.is_empty(), "vertex {u} is dropped but has faces");
                    continue;
                }
                // The outcome is determined by u and t; the records must agree.
                let (gone, stay): (Vec<u32>, Vec<u32>) =
                    star.into_iter().partition(|f| faces[f].iter().any(|&w| vertex(w) == t));
                let mut listed: Vec<u32> = removed.iter().map(|r| r.face).collect();
                listed.sort_unstable();
                assert_eq!(gone, listed, "faces that vanish when {u} goes onto {t}");
                assert_eq!(stay.len(), moved_positions.len(), "faces that move when {u} goes onto {t}");
                for face in gone {
                    faces.remove(&face);
                }
                for m in moved_positions {
                    let corner =
                        faces.get_mut(&m.face).unwrap().iter_mut().find(|w| vertex(**w) == u).unwrap();
                    assert_eq!(*corner, m.from, "face {} is not as the builder saw it", m.face);
                    assert_eq!(vertex(m.to), t);
                    *corner = m.to;
                    let list = around.entry(t).or_default();
                    if let Err(at) = list.binary_search(&m.face) {
                        list.insert(at, m.face);
                    }
                }
            }
        }
        faces.into_iter().map(|(f, w)| (f, rotated(w))).collect()
    }

    /// Positions of the vertices that chunks of `set` move: those of the finest such chunk.
    fn moved_positions(&self, set: &[Member]) -> BTreeMap<u32, [i32; 3]> {
        let chunk = |m: &Member| &self.regions[m.chunk as usize];
        // Ids ascend from coarse to fine, so the finest wins.
        set.iter().flat_map(|m| chunk(m).moves.iter().map(|m| (m.vertex, m.cell))).collect()
    }

    /// A refined mesh in the builder's ids; asserts that wedges, vertices and moved positions are the builder's.
    fn named(&self, mesh: &ActiveMesh, set: &[Member]) -> Faces {
        let moved_positions = self.moved_positions(set);
        let snapshot = mesh.snapshot();
        let name = |lists: &[Vec<u32>], id: Id| lists[id.owner as usize][id.index as usize];
        for &(id, position, _) in &snapshot.vertices {
            let vertex = name(&self.vertices, id);
            let left = || self.simplified.placed(vertex).cell;
            assert_eq!(
                position,
                moved_positions.get(&vertex).copied().unwrap_or_else(left),
                "vertex {vertex}"
            );
            if set.len() == self.infos.len() && set.iter().all(|m| m.truncation.is_none()) {
                assert_eq!(position, self.mesh.positions[vertex as usize], "vertex {vertex} of the input");
            }
        }
        for &(id, vertex, attributes) in &snapshot.wedges {
            let expected = self.simplified.wedges.get(name(&self.wedges, id));
            assert_eq!(Wedge { vertex: name(&self.vertices, vertex), attributes }, expected);
        }
        let mut faces = Faces::new();
        for &(id, wedges, material) in &snapshot.faces {
            let face = name(&self.faces, id);
            assert_eq!(material, self.mesh.faces[face as usize].material);
            assert!(faces.insert(face, rotated(wedges.map(|w| name(&self.wedges, w)))).is_none());
        }
        faces
    }
}

fn rotated(w: [u32; 3]) -> [u32; 3] {
    [w, [w[1], w[2], w[0]], [w[2], w[0], w[1]]].into_iter().min().unwrap_or(w)
}

#[test]
fn any_ancestor_closed_cut_is_the_input_collapsed_by_the_complement() {
    let (mut at_truncation_points, mut moves) = (0, 0);
    for (name, source) in common::all() {
        let mesh = common::quantised(&source);
        let blocks = Settings { block_faces: 500, ..common::regions(100) };
        for settings in [50, 200, 1000].map(common::regions).into_iter().chain([blocks]) {
            let (checkpoint, mut merged) = (InMemoryCheckpoint::default(), None);
            let case = Case::new(&mesh, &settings, (&checkpoint, &mut merged));
            moves += case.moved_positions(&case.all_chunks()).len();
            let mut random = Random::new(31);
            for attempt in 0..8 {
                let set = match attempt {
                    0 => Vec::new(),
                    1 => case.all_chunks(),
                    _ => ancestor_closed_cut::random(&case.infos, &mut random),
                };
                let mut active = ActiveMesh::new(&case.base);
                for Member { chunk: id, truncation } in
                    ancestor_closed_cut::random_order(&case.infos, &set, &mut random)
                {
                    let (info, payload) = (&case.infos[id as usize], &case.payloads[id as usize]);
                    let delta = active
                        .decode_prefix(id, info, truncation, payload)
                        .unwrap_or_else(|e| panic!("{name} {settings:?} {attempt}: {e} {info:?}"));
                    let canonical = truncation.is_some() || delta == case.deltas[id as usize];
                    assert!(canonical, "{name}: chunk {id} is not canonical");
                    active.apply(&delta).unwrap();
                    at_truncation_points += usize::from(truncation.is_some());
                }
                assert!(
                    case.named(&active, &set) == case.collapsed(&set),
                    "{name}, {settings:?}: {} of {} chunks",
                    set.len(),
                    case.infos.len()
                );
            }
        }
    }
    assert!(at_truncation_points >= 100, "only {at_truncation_points} chunks ended at a truncation");
    assert!(moves >= 1000, "only {moves} vertices moved");
}

#[test]
fn the_reference_differs_when_one_chunk_is_left_out() {
    let mesh = common::quantised(&common::shapes::torus(40, 70));
    let (checkpoint, mut merged) = (InMemoryCheckpoint::default(), None);
    let case = Case::new(&mesh, &common::regions(200), (&checkpoint, &mut merged));
    let all = case.all_chunks();
    assert!(case.collapsed(&all) != case.collapsed(&all[..all.len() - 1]));
}
