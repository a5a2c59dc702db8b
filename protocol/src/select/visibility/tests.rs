//! What the rasteriser calls hidden, against rays.

use std::collections::HashSet;

use geometry::index::ChunkInfo;
use geometry::mesh::{Corner, SourceMesh};
use geometry::pool::{Serial, Silent};
use geometry::prepare::{Hooks, Prepared, prepare};
use geometry::quantise::{QuantiseSettings, quantise};
use geometry::refine::ActiveMesh;
use lodestream_geometry as geometry;

use super::*;
use crate::blob::{BlobId, BlobPart};
use crate::select::priority::is_hidden;
use crate::select::{Selector, State, Wanted};

const RINGS: u32 = 72;
const COLUMNS: u32 = 120;

/// A closed ball of radius 1 with bumps, scaled along its axes.
fn ball(scale: [f64; 3], bumps: f64) -> SourceMesh {
    let mut mesh = SourceMesh::default();
    let point = |polar: f64, around: f64| {
        let r = 1.0
            + bumps
                * ((5.0 * polar).sin() * (4.0 * around).sin() + 0.3 * (23.0 * polar * around.cos()).sin());
        [polar.sin() * around.cos(), polar.cos(), polar.sin() * around.sin()].map(|x| r * x)
    };
    for ring in 0..=RINGS {
        let columns = if ring == 0 || ring == RINGS { 1 } else { COLUMNS };
        for column in 0..columns {
            let polar = std::f64::consts::PI * f64::from(ring) / f64::from(RINGS);
            let around = std::f64::consts::TAU * f64::from(column) / f64::from(COLUMNS);
            let [x, y, z] = point(polar, around);
            mesh.positions.push([scale[0] * x, scale[1] * y, scale[2] * z]);
        }
    }
    let at = |ring: u32, column: u32| match ring {
        0 => 0,
        RINGS => 1 + (RINGS - 1) * COLUMNS,
        _ => 1 + (ring - 1) * COLUMNS + column % COLUMNS,
    };
    for ring in 0..RINGS {
        for column in 0..COLUMNS {
            let (a, b) = (at(ring, column), at(ring, column + 1));
            let (c, d) = (at(ring + 1, column), at(ring + 1, column + 1));
            let faces = [[a, b, d], [a, d, c]];
            for face in faces.into_iter().filter(|[a, b, c]| a != b && b != c && c != a) {
                mesh.faces.push(face.map(Corner::at));
                mesh.materials.push(0);
            }
        }
    }
    mesh
}

/// A prepared asset, as far refined as it is.
struct Asset {
    prepared: Prepared,
    mesh: ActiveMesh,
    state: AssetState,
}

impl Asset {
    fn new(source: &SourceMesh) -> Self {
        let settings = geometry::Settings { region_faces: 400, ..geometry::Settings::default() };
        let quantised = quantise(source, &QuantiseSettings::default()).unwrap();
        let prepared = prepare(&quantised, &settings, &Hooks::new(&Serial, &Silent)).unwrap();
        let base = &prepared.base;
        let mut state = AssetState::new(AssetEntry {
            origin: base.grid.origin,
            sphere: base.sphere,
            root_error: prepared.infos.iter().map(|info| info.error).fold(base.geometric_error, f32::max),
            chunk_count: base.chunk_count,
            ..AssetEntry::default()
        });
        state.set_state(BlobPart::Base, State::Applied);
        for (page, infos) in (0..).zip(prepared.infos.chunks(geometry::index::CHUNKS_PER_PAGE)) {
            state.add_index_page(page, infos.to_vec()).unwrap();
        }
        let mesh = ActiveMesh::new(base);
        let mut asset = Self { prepared, mesh, state };
        asset.look();
        asset
    }

    fn look(&mut self) {
        let (positions, faces) = self.mesh.surface();
        self.state.set_occluder(Arc::new(Occluder::new(positions, faces)));
    }

    fn apply(&mut self, chunk: u32) {
        let (info, payload) = (&self.prepared.infos[chunk as usize], &self.prepared.chunks[chunk as usize]);
        let delta = self.mesh.decode(chunk, info, payload).unwrap();
        self.mesh.apply(&delta).unwrap();
        self.state.set_state(BlobPart::Chunk(chunk), State::Applied);
    }

    /// All faces of the finest mesh as points, and per face the chunks that put its corners where they are.
    fn finest(&self) -> Vec<([Vec3; 3], [Option<u32>; 3])> {
        let mut mesh = ActiveMesh::new(&self.prepared.base);
        for (chunk, (info, payload)) in (0..).zip(self.prepared.infos.iter().zip(&self.prepared.chunks)) {
            let delta = mesh.decode(chunk, info, payload).unwrap();
            mesh.apply(&delta).unwrap();
        }
        let faces = mesh.indices(0).iter().filter(|face| **face != [0; 3]);
        faces
            .map(|face| {
                let corner = |wedge: u32| Vec3::from(mesh.render_vertex(wedge).position);
                (face.map(corner), face.map(|wedge| mesh.wedge_chunk(wedge)))
            })
            .collect()
    }
}

/// Whether a triangle is hit on the way from the origin to a point, before it.
fn blocks([a, b, c]: &[Vec3; 3], to: Vec3) -> bool {
    let (ab, ac) = (*b - *a, *c - *a);
    let across = to.cross(ac);
    let determinant = ab.dot(across);
    if determinant == 0.0 {
        return false;
    }
    let from = -*a;
    let u = from.dot(across) / determinant;
    let around = from.cross(ab);
    let v = to.dot(around) / determinant;
    let t = ac.dot(around) / determinant;
    u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t < 0.999
}

/// Faces that a view sees, as (instance, number), every `step`th looked at: a ray to their middle meets no other.
fn seen_by_rays(view: &View, world: &[Vec<[Vec3; 3]>], step: usize) -> Vec<(usize, usize)> {
    let tangent = (view.fov_y / 2.0).tan();
    let mut seen = Vec::new();
    for (instance, faces) in world.iter().enumerate() {
        for (number, [a, b, c]) in faces.iter().enumerate().step_by(step) {
            let to = (*a + *b + *c) / 3.0;
            let inside = to.x.abs() < tangent * view.aspect() * to.z && to.y.abs() < tangent * to.z;
            // Counter-clockwise from outside, and these axes mirror the world.
            let turned_away = (*b - *a).cross(*c - *a).dot(to) >= 0.0;
            if inside && !turned_away && !world.iter().flatten().any(|face| blocks(face, to)) {
                seen.push((instance, number));
            }
        }
    }
    seen
}

#[test]
fn of_what_rays_see_hardly_anything_is_called_hidden() {
    let mut assets = [Asset::new(&ball([1.0; 3], 0.12)), Asset::new(&ball([0.2, 1.6, 0.9], 0.03))];
    let finest: Vec<_> = assets.iter().map(Asset::finest).collect();
    let place = |asset, translation, scale| InstanceEntry { scale, ..InstanceEntry::at(asset, translation) };
    let instances =
        [place(0, [0.0; 3], 1.0), place(0, [0.3, 0.1, -4.0], 1.5), place(1, [0.9, 0.0, 1.4], 1.0)];
    let eyes = [[0.0, 0.4, 4.0], [3.0, 2.0, 2.5], [-2.2, -0.5, -1.5], [6.0, 5.0, -9.0]];
    let views = eyes.map(|eye| {
        let view = View::look_at(eye, [0.2, 0.0, -0.6], [0.0, 1.0, 0.0], 0.9, [1280, 720]);
        let world: Vec<Vec<_>> = instances
            .iter()
            .map(|instance| {
                let asset = instance.asset as usize;
                let placed = Placed::new(&view, assets[asset].state.entry(), instance);
                let corners = finest[asset].iter().map(|(corners, _)| corners);
                corners.map(|face| face.map(|p| placed.place(p.to_array()))).collect()
            })
            .collect();
        (View { target_px: 0.2, ..view }, seen_by_rays(&view, &world, 61))
    });
    let (mut seen, mut wrong) = (0, 0);
    for stage in 0..4 {
        let (mut all_bytes, mut last_bytes) = (0, 0);
        for (view, faces) in &views {
            let states: Vec<_> = assets.iter().map(|asset| asset.state.clone()).collect();
            let mut selector = Selector::default();
            let selection = selector.select(view, &instances, &states);
            let (wanted, counters) = (&selection.wanted, selection.counters);
            assert!(counters.seen_screen_error_px <= counters.max_screen_error_px, "{counters:?}");
            let hidden: HashSet<BlobId> =
                wanted.iter().filter(|w| is_hidden(w.priority)).map(|w| w.id).collect();
            let bytes = |w: &Wanted| w.bytes.unwrap_or(0);
            all_bytes += wanted.iter().map(bytes).sum::<u32>();
            last_bytes += wanted.iter().filter(|w| hidden.contains(&w.id)).map(bytes).sum::<u32>();
            for &(instance, number) in faces {
                let asset = instances[instance].asset;
                let chunks = finest[asset as usize][number].1.into_iter().flatten();
                seen += 1;
                wrong += usize::from(chunks.into_iter().any(|c| hidden.contains(&BlobId::chunk(asset, c))));
            }
        }
        // A good part of what is in view is hidden, and the more is known of surfaces, the more of it is called so.
        assert!(last_bytes * [15, 8, 6, 6][stage] > all_bytes, "{last_bytes} of {all_bytes}, stage {stage}");
        for asset in &mut assets {
            for chunk in 0..(asset.prepared.infos.len() * (stage + 1) / 6) as u32 {
                if asset.state.state(BlobPart::Chunk(chunk)) != State::Applied {
                    asset.apply(chunk);
                }
            }
            asset.look();
        }
    }
    assert!(seen > 2000, "{seen}");
    assert!(wrong * 1000 <= seen, "{wrong} of {seen} faces that rays see are called hidden");
}

fn flat(distance: f32, half: f32) -> Occluder {
    let corner = |x: f32, y: f32| [x * half, y * half, -distance];
    let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    Occluder::new(corners.to_vec(), vec![[0, 1, 2], [0, 2, 3], [0, 1, 9]])
}

/// An asset with one chunk, whose region is a ball at `depth` before the eye, and the share of it that is seen.
fn share_behind(occluder: Occluder, at: [f32; 3], radius: f32, error: f32, way: f32) -> f32 {
    let sphere = Sphere { center: at, radius };
    let mut state =
        AssetState::new(AssetEntry { sphere, chunk_count: 1, root_error: error, ..Default::default() });
    state.set_state(BlobPart::Base, State::Applied);
    state.add_index_page(0, vec![ChunkInfo { sphere, error, ..ChunkInfo::default() }]).unwrap();
    state.set_occluder(Arc::new(occluder));
    let view = View::look_at([0.0; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], 0.9, [1280, 720]);
    let (instances, states) = ([InstanceEntry::at(0, [0.0; 3])], [state]);
    let mut visibility = Visibility::default();
    visibility.draw(&view, way, &instances, &states);
    let placed = Placed::new(&view, states[0].entry(), &instances[0]);
    let mut shares = [1.0];
    visibility.shares(0, &placed, states[0].chunks(), |_, _| true, &mut shares);
    shares[0]
}

#[test]
fn a_region_is_seen_as_far_as_its_own_surface_is_in_front() {
    let share = |occluder, at| share_behind(occluder, at, 1.0, 0.01, 0.0);
    // The wall passes through the region's middle: its own surface.
    assert!(share(flat(10.0, 9.0), [0.0, 0.0, -10.0]) > 0.9);
    // Far behind it, beside it, and half behind it.
    assert_eq!(share(flat(10.0, 9.0), [0.0, 0.0, -20.0]), 0.0);
    let beside = share(flat(10.0, 1.0), [4.0, 0.0, -20.0]);
    assert!(beside > 0.0 && beside < 0.2, "one sees through where it should be: {beside}");
    let edge = share(flat(10.0, 1.0), [2.0, 0.0, -20.0]);
    assert!(edge > 0.0 && edge < beside, "{edge}");
    assert_eq!(share(flat(10.0, 9.0), [0.0, 0.0, -0.5]), 1.0, "the eye is in it");
    // A surface that may be far off hides nothing that near.
    assert_eq!(share_behind(flat(10.0, 9.0), [0.0, 0.0, -12.5], 1.0, 0.1, 0.0), 0.0);
    assert!(share_behind(flat(10.0, 9.0), [0.0, 0.0, -12.5], 1.0, 3.0, 0.0) > 0.0);
}

#[test]
fn what_an_eye_that_moves_uncovers_counts_as_seen() {
    let at_edge = |way| share_behind(flat(10.0, 1.0), [1.2, 0.0, -15.0], 0.3, 0.01, way);
    assert_eq!(at_edge(0.0), 0.0);
    assert!(at_edge(0.5) > 0.0);
}

#[test]
fn surfaces_may_be_anything() {
    for bad in [f32::NAN, f32::INFINITY, -0.0, 1e30, 1e-30] {
        let corners = vec![[bad, 0.0, -1.0], [0.0, bad, -1.0], [1.0, 1.0, bad], [0.0, 0.0, -2.0]];
        let faces = vec![[0, 1, 2], [0, 1, 3], [3, 3, 3], [7, 0, 1]];
        for at in [[0.0, 0.0, -3.0], [bad, 0.0, -3.0], [0.0, 0.0, bad]] {
            for size in [0.0, 1.0, bad] {
                let share = share_behind(Occluder::new(corners.clone(), faces.clone()), at, size, size, size);
                assert!((0.0..=1.0).contains(&share), "{bad} {at:?} {size}: {share}");
            }
        }
    }
}
