//! The occlusion test against ray casting.

use std::collections::HashSet;

use geometry::index::ChunkInfo;
use geometry::mesh::{Corner, SourceMesh};
use geometry::pool::{Serial, Silent};
use geometry::prepare::{Hooks, Prepared, prepare};
use geometry::quantise::{QuantiseSettings, quantise};
use geometry::refine::ActiveMesh;
use lodestream_geometry as geometry;

use super::*;
use crate::priority::is_hidden;
use crate::{Selector, State, Wanted};
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::placement::Placement;

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

/// A closed, wavy wall of the given width, height and thickness, across the z axis. The waves do not depend on its
/// size.
fn sheet([width, height, thickness]: [f64; 3]) -> SourceMesh {
    let mut mesh = SourceMesh::default();
    let wave = |x: f64, y: f64| 0.03 * (2.1 * x).sin() * (2.7 * y).cos() + 0.004 * (11.0 * x + 9.0 * y).sin();
    for side in [0.5, -0.5] {
        for row in 0..=RINGS {
            for column in 0..=COLUMNS {
                let x = width * (f64::from(column) / f64::from(COLUMNS) - 0.5);
                let y = height * (f64::from(row) / f64::from(RINGS) - 0.5);
                mesh.positions.push([x, y, wave(x, y) + side * thickness]);
            }
        }
    }
    let back = (RINGS + 1) * (COLUMNS + 1);
    let at = |row: u32, column: u32| row * (COLUMNS + 1) + column;
    let mut quad = |[a, b, c, d]: [u32; 4]| {
        for face in [[a, b, c], [a, c, d]] {
            mesh.faces.push(face.map(Corner::at));
            mesh.materials.push(0);
        }
    };
    for row in 0..RINGS {
        for column in 0..COLUMNS {
            let [a, b, c, d] =
                [at(row, column), at(row, column + 1), at(row + 1, column + 1), at(row + 1, column)];
            quad([a, b, c, d]);
            quad([d, c, b, a].map(|corner| corner + back));
        }
    }
    let around = (0..COLUMNS)
        .map(|c| [at(0, c), at(0, c + 1)])
        .chain((0..RINGS).map(|r| [at(r, COLUMNS), at(r + 1, COLUMNS)]))
        .chain((0..COLUMNS).rev().map(|c| [at(RINGS, c + 1), at(RINGS, c)]))
        .chain((0..RINGS).rev().map(|r| [at(r + 1, 0), at(r, 0)]));
    for [from, to] in around.collect::<Vec<_>>() {
        quad([to, from, from + back, to + back]);
    }
    mesh
}

/// A face's corners, and the chunks that give them their positions.
type FinestFace = ([Vec3; 3], [Option<u32>; 3]);

/// A prepared asset in its current state of refinement.
#[derive(Clone)]
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
        asset.update_occluder();
        asset
    }

    /// The same with chunks that state attribute errors only, so that no margin is added for coarse surfaces.
    fn without_geometric_errors(&self) -> Self {
        let mut state = AssetState::new(self.state.entry().clone());
        state.set_state(BlobPart::Base, State::Applied);
        for (page, infos) in (0..).zip(self.prepared.infos.chunks(geometry::index::CHUNKS_PER_PAGE)) {
            let unbounded = |info: &ChunkInfo| ChunkInfo {
                error: 0.0,
                attribute_error: info.error.max(info.attribute_error),
                ..info.clone()
            };
            state.add_index_page(page, infos.iter().map(unbounded).collect::<Vec<_>>()).unwrap();
        }
        let mut asset = Self { state, ..self.clone() };
        asset.update_occluder();
        asset
    }

    fn update_occluder(&mut self) {
        let (positions, faces) = self.mesh.surface();
        self.state.set_occluder(Arc::new(Occluder::new(positions, faces)));
    }

    fn apply(&mut self, chunk: u32) {
        let (info, payload) = (&self.prepared.infos[chunk as usize], &self.prepared.chunks[chunk as usize]);
        let delta = self.mesh.decode(chunk, info, payload).unwrap();
        self.mesh.apply(&delta).unwrap();
        self.state.set_state(BlobPart::Chunk(chunk), State::Applied);
    }

    /// All faces of the finest mesh.
    fn finest(&self) -> Vec<FinestFace> {
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

/// Whether the ray from the origin to a point meets a triangle before the point.
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

/// Cells of the picture on each side of its centre.
const CELLS: i32 = 40;

/// Faces by the cells of the picture that they may cover.
struct Cells<'a> {
    faces: Vec<Vec<&'a [Vec3; 3]>>,
    /// Cells per unit of tangent.
    scale: f32,
}

impl<'a> Cells<'a> {
    fn new(view: &View, faces: impl Iterator<Item = &'a [Vec3; 3]>) -> Self {
        let scale = CELLS as f32 / ((view.fov_y / 2.0).tan() * view.aspect().max(1.0));
        let mut cells = Self { faces: vec![Vec::new(); (4 * CELLS * CELLS) as usize], scale };
        for face in faces {
            let in_front = face.iter().all(|corner| corner.z > 1e-6);
            let behind = face.iter().all(|corner| corner.z <= 0.0);
            let [x, y] = match (in_front, behind) {
                (_, true) => continue,
                (true, _) => [0, 1].map(|axis| {
                    let at = face.map(|corner| cells.at(corner[axis], corner.z));
                    let [a, b, c] = at;
                    a.min(b).min(c)..=a.max(b).max(c)
                }),
                (false, false) => [-CELLS..=CELLS - 1, -CELLS..=CELLS - 1],
            };
            for row in y {
                for column in x.clone() {
                    cells.faces[Self::number(column, row)].push(face);
                }
            }
        }
        cells
    }

    fn at(&self, x: f32, z: f32) -> i32 {
        ((x / z * self.scale).floor() as i32).clamp(-CELLS, CELLS - 1)
    }

    fn number(column: i32, row: i32) -> usize {
        ((row + CELLS) * 2 * CELLS + column + CELLS) as usize
    }

    /// Whether the ray to a point in view meets a face before the point.
    fn block(&self, to: Vec3) -> bool {
        let cell = Self::number(self.at(to.x, to.z), self.at(to.y, to.z));
        self.faces[cell].iter().any(|face| blocks(face, to))
    }
}

/// Faces visible in a view, as (instance, number): a ray to their centre meets no other face. Tests every `step`th
/// face.
fn seen_by_rays(view: &View, world: &[Vec<[Vec3; 3]>], step: usize) -> Vec<(usize, usize)> {
    let tangent = (view.fov_y / 2.0).tan();
    let cells = Cells::new(view, world.iter().flatten());
    let mut seen = Vec::new();
    for (instance, faces) in world.iter().enumerate() {
        for (number, [a, b, c]) in faces.iter().enumerate().step_by(step) {
            let to = (*a + *b + *c) / 3.0;
            let inside = to.x.abs() < tangent * view.aspect() * to.z && to.y.abs() < tangent * to.z;
            // Faces are counter-clockwise from outside, and these axes mirror the world.
            let turned_away = (*b - *a).cross(*c - *a).dot(to) >= 0.0;
            if inside && !turned_away && !cells.block(to) {
                seen.push((instance, number));
            }
        }
    }
    seen
}

/// Assets and their instances.
struct Scene {
    assets: Vec<Asset>,
    /// Of each asset, [`Asset::finest`].
    finest: Vec<Vec<FinestFace>>,
    instances: Vec<Instance>,
}

/// A selection for a view, compared with what rays see.
#[derive(Default)]
struct OcclusionCheck {
    /// Faces that rays see, and those of them that the selection calls hidden.
    seen: usize,
    wrong: usize,
    /// Bytes of all wanted blobs, and of those wanted last.
    bytes: u32,
    last_bytes: u32,
}

impl Scene {
    fn new(assets: &[Asset], instances: &[Instance]) -> Self {
        let finest = assets.iter().map(Asset::finest).collect();
        Self { assets: assets.to_vec(), finest, instances: instances.to_vec() }
    }

    /// Every `step`th face, if rays from a view's eye see it.
    fn seen_from(&self, view: &View, step: usize) -> Vec<(usize, usize)> {
        let world = self.instances.iter().map(|instance| {
            let asset = instance.asset as usize;
            let placed = Placed::new(view, self.assets[asset].state.entry(), instance);
            let corners = self.finest[asset].iter().map(|(corners, _)| corners);
            corners.map(|face| face.map(|p| placed.place(p.to_array()))).collect()
        });
        seen_by_rays(view, &world.collect::<Vec<Vec<_>>>(), step)
    }

    /// Compares the faces that rays see with those that a selection calls hidden, for an eye that may move by a
    /// distance.
    fn check(&self, view: &View, distance: f32, faces: &[(usize, usize)]) -> OcclusionCheck {
        let states: Vec<_> = self.assets.iter().map(|asset| asset.state.clone()).collect();
        let mut selector = Selector::default();
        selector.set_travel_distance(distance);
        let selection = selector.select(view, &self.instances, &states);
        let (wanted, counters) = (&selection.wanted, selection.counters);
        assert!(counters.unoccluded_screen_error_px <= counters.max_screen_error_px, "{counters:?}");
        let hidden: HashSet<BlobId> = wanted.iter().filter(|w| is_hidden(w.priority)).map(|w| w.id).collect();
        let bytes = |w: &Wanted| w.bytes.unwrap_or(0);
        let is_wrong = |&&(instance, number): &&(usize, usize)| {
            let asset = self.instances[instance].asset;
            let mut chunks = self.finest[asset as usize][number].1.into_iter().flatten();
            chunks.any(|chunk| hidden.contains(&BlobId::chunk(asset, chunk)))
        };
        OcclusionCheck {
            seen: faces.len(),
            wrong: faces.iter().filter(is_wrong).count(),
            bytes: wanted.iter().map(bytes).sum(),
            last_bytes: wanted.iter().filter(|w| hidden.contains(&w.id)).map(bytes).sum(),
        }
    }

    /// The same, summed over views with the faces seen from each, at four stages: from base meshes to most chunks
    /// applied.
    fn check_stages(&mut self, distance: f32, views: &[(View, Vec<(usize, usize)>)]) -> [OcclusionCheck; 4] {
        [0, 1, 2, 3].map(|stage| {
            let mut all = OcclusionCheck::default();
            for (view, faces) in views {
                let OcclusionCheck { seen, wrong, bytes, last_bytes } = self.check(view, distance, faces);
                all.seen += seen;
                all.wrong += wrong;
                all.bytes += bytes;
                all.last_bytes += last_bytes;
            }
            for asset in &mut self.assets {
                for chunk in 0..(asset.prepared.infos.len() * (stage + 1) / 6) as u32 {
                    if asset.state.state(BlobPart::Chunk(chunk)) != State::Applied {
                        asset.apply(chunk);
                    }
                }
                asset.update_occluder();
            }
            all
        })
    }
}

fn view_from(eye: [f64; 3]) -> View {
    let view = View::look_at(eye, [0.2, 0.0, -0.6], [0.0, 1.0, 0.0], 0.9, [1280, 720]);
    View { target_px: 0.2, ..view }
}

fn place(asset: u32, translation: [f64; 3], scale: f32) -> Instance {
    Instance { asset, placement: Placement { scale, ..Placement::at(translation) } }
}

/// Asserts that at most one in a thousand of the faces that rays see is called hidden, and that rays see enough faces.
fn assert_hardly_any_wrong(what: &str, stages: &[OcclusionCheck]) {
    let (seen, wrong) = stages.iter().fold((0, 0), |(seen, wrong), s| (seen + s.seen, wrong + s.wrong));
    let by_stage: Vec<_> = stages.iter().map(|s| (s.seen, s.wrong, s.bytes, s.last_bytes)).collect();
    println!("{what}: {wrong} of {seen} faces that rays see are called hidden; {by_stage:?}");
    assert!(seen > 2000, "{what}: {seen}");
    assert!(wrong * 1000 <= seen, "{what}: {wrong} of {seen} faces that rays see are called hidden");
}

#[test]
fn surfaces_visible_to_rays_are_rarely_hidden() {
    let sources = [ball([1.0; 3], 0.12), ball([0.2, 1.6, 0.9], 0.03)];
    let instances =
        [place(0, [0.0; 3], 1.0), place(0, [0.3, 0.1, -4.0], 1.5), place(1, [0.9, 0.0, 1.4], 1.0)];
    let mut scene = Scene::new(&sources.each_ref().map(Asset::new), &instances);
    let eyes = [[0.0, 0.4, 4.0], [3.0, 2.0, 2.5], [-2.2, -0.5, -1.5], [6.0, 5.0, -9.0]];
    let views = eyes.map(view_from).map(|view| (view, scene.seen_from(&view, 7)));
    let stages = scene.check_stages(0.0, &views);
    for (stage, check) in stages.iter().enumerate() {
        let OcclusionCheck { bytes, last_bytes, .. } = check;
        // Much of what is in view is hidden, and the more surfaces are known, the more is called hidden.
        assert!(last_bytes * [15, 8, 6, 6][stage] > *bytes, "{last_bytes} of {bytes}, stage {stage}");
    }
    assert_hardly_any_wrong("balls", &stages);
}

/// The walls are far thinner than a pixel of the buffer (about 0.03 here), and one stands close behind another, of
/// which only a margin is visible: an error of a fraction of a pixel, or of a coarse surface, calls visible faces
/// hidden.
#[test]
fn thin_walls_visible_to_rays_are_rarely_hidden() {
    let sources = [sheet([2.4, 1.6, 0.004]), sheet([3.0, 2.2, 0.004]), ball([0.5; 3], 0.05)];
    let assets = sources.each_ref().map(Asset::new);
    for gap in [0.008, 0.02, 0.1] {
        let instances = [
            place(0, [0.0; 3], 1.0),
            place(1, [0.0, 0.0, -gap], 1.0),
            place(2, [1.2, 0.6, -1.2], 1.0),
            place(2, [-0.9, -0.4, 0.9], 0.6),
        ];
        let mut scene = Scene::new(&assets, &instances);
        let eyes = [[0.0, 0.4, 4.0], [3.0, 2.0, 2.5], [-4.0, 0.3, 0.3], [0.5, -0.8, -5.0]];
        let views = eyes.map(view_from).map(|view| (view, scene.seen_from(&view, 7)));
        let stages = scene.check_stages(0.0, &views);
        assert!(stages.iter().all(|check| check.last_bytes > 0), "nothing is hidden");
        assert_hardly_any_wrong(&format!("walls {gap} apart"), &stages);
        let mut unbounded = Scene::new(&assets.each_ref().map(Asset::without_geometric_errors), &instances);
        let wrong = |stages: &[OcclusionCheck]| stages.iter().map(|check| check.wrong).sum::<usize>();
        assert!(
            wrong(&unbounded.check_stages(0.0, &views)) > wrong(&stages),
            "no margin for the error of surfaces"
        );
    }
}

/// The faces that any eye within the distance sees: at the centre of a sphere, and on its surface.
#[test]
fn surfaces_visible_along_a_path_are_rarely_hidden() {
    let sources = [ball([1.0; 3], 0.12), ball([0.2, 1.6, 0.9], 0.03), sheet([1.4, 1.0, 0.004])];
    let instances = [
        place(0, [0.0; 3], 1.0),
        place(0, [0.3, 0.1, -4.0], 1.5),
        place(1, [0.9, 0.0, 1.4], 1.0),
        place(2, [-0.8, 0.3, 1.3], 1.0),
    ];
    let assets = sources.each_ref().map(Asset::new);
    for distance in [0.02, 0.1] {
        let mut scene = Scene::new(&assets, &instances);
        let views = [[0.0, 0.4, 4.0], [3.0, 2.0, 2.5], [-2.2, -0.5, -2.5]].map(view_from).map(|view| {
            let moved = |x, y, z| {
                let to = DVec3::new(x, y, z).normalize_or_zero() * f64::from(distance);
                View { eye: (DVec3::from(view.eye) + to).to_array(), ..view }
            };
            let eyes = [
                moved(0.0, 0.0, 0.0),
                moved(1.0, 0.0, 0.0),
                moved(-1.0, 0.0, 0.0),
                moved(0.0, 1.0, 0.0),
                moved(0.0, -1.0, 0.0),
                moved(0.0, 0.0, 1.0),
                moved(0.0, 0.0, -1.0),
            ];
            let mut faces: Vec<_> = eyes.iter().flat_map(|eye| scene.seen_from(eye, 7)).collect();
            faces.sort_unstable();
            faces.dedup();
            (view, faces)
        });
        let stages = scene.check_stages(distance, &views);
        assert!(stages.iter().all(|check| check.last_bytes > 0), "nothing is hidden");
        assert_hardly_any_wrong(&format!("movement by {distance}"), &stages);
        // Without the movement, more is called hidden.
        let standing = Scene::new(&assets, &instances).check_stages(0.0, &views);
        for (moving, standing) in stages.iter().zip(&standing) {
            assert!(moving.last_bytes < standing.last_bytes, "silhouettes do not shrink");
            assert!(moving.wrong <= standing.wrong, "{} and {}", moving.wrong, standing.wrong);
        }
    }
}

fn flat(distance: f32, half: f32) -> Occluder {
    let corner = |x: f32, y: f32| [x * half, y * half, -distance];
    let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    Occluder::new(corners.to_vec(), vec![[0, 1, 2], [0, 2, 3], [0, 1, 9]])
}

/// The visible share of the only chunk of an asset, whose region is a ball at `at`.
fn share_behind(occluder: Occluder, at: [f32; 3], radius: f32, error: f32, distance: f32) -> f32 {
    let sphere = Sphere { center: at, radius };
    let mut state =
        AssetState::new(AssetEntry { sphere, chunk_count: 1, root_error: error, ..Default::default() });
    state.set_state(BlobPart::Base, State::Applied);
    state.add_index_page(0, vec![ChunkInfo { sphere, error, ..ChunkInfo::default() }]).unwrap();
    state.set_occluder(Arc::new(occluder));
    let view = View::look_at([0.0; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], 0.9, [1280, 720]);
    let (instances, states) = ([Instance::at(0, [0.0; 3])], [state]);
    let mut visibility = Visibility::default();
    visibility.draw(&view, distance, instances[..].into(), &states);
    let placed = Placed::new(&view, states[0].entry(), &instances[0]);
    let mut shares = [1.0];
    visibility.shares(0, &placed, states[0].chunks(), |_, _| true, &mut shares);
    shares[0]
}

#[test]
fn visible_share_is_that_of_the_regions_own_surface() {
    let share = |occluder, at| share_behind(occluder, at, 1.0, 0.01, 0.0);
    // The wall passes through the region's centre, so it is the region's own surface.
    assert!(share(flat(10.0, 9.0), [0.0, 0.0, -10.0]) > 0.9);
    // The region is far behind the wall, beside it, and half behind it.
    assert_eq!(share(flat(10.0, 9.0), [0.0, 0.0, -20.0]), 0.0);
    let beside = share(flat(10.0, 1.0), [4.0, 0.0, -20.0]);
    assert!(beside > 0.0 && beside < 0.2, "the background is visible beside the wall: {beside}");
    let edge = share(flat(10.0, 1.0), [2.0, 0.0, -20.0]);
    assert!(edge > 0.0 && edge < beside, "{edge}");
    assert_eq!(share(flat(10.0, 9.0), [0.0, 0.0, -0.5]), 1.0, "the eye is inside the region");
    // A surface with a large error does not hide a region so close behind it.
    assert_eq!(share_behind(flat(10.0, 9.0), [0.0, 0.0, -12.5], 1.0, 0.1, 0.0), 0.0);
    assert!(share_behind(flat(10.0, 9.0), [0.0, 0.0, -12.5], 1.0, 3.0, 0.0) > 0.0);
}

#[test]
fn missing_regions_count_by_their_error() {
    let far = |error| share_behind(flat(30.0, 20.0), [0.0, 0.0, -10.0], 1.0, error, 0.0);
    let near_by = far(0.001);
    assert!(near_by > 0.0 && near_by < 0.05, "{near_by}");
    let missing = [0.1, 0.3, 1.0].map(far);
    assert!(missing[0] > 3.0 * near_by && missing.is_sorted(), "{missing:?}");
    // The depth buffer is behind the whole region: the root of the uncovered share counts.
    assert!((missing[1] - (UNCOVERED * 0.3).sqrt()).abs() < 0.02, "{missing:?}");
    // What hides the coarse surface hides the missing region too.
    assert_eq!(share_behind(flat(10.0, 9.0), [0.0, 0.0, -20.0], 1.0, 0.3, 0.0), 0.0);
}

#[test]
fn regions_uncovered_by_movement_count_as_visible() {
    let at_edge = |distance| share_behind(flat(10.0, 1.0), [1.2, 0.0, -15.0], 0.3, 0.01, distance);
    assert_eq!(at_edge(0.0), 0.0);
    assert!(at_edge(0.5) > 0.0);
}

#[test]
fn degenerate_surfaces_do_not_panic() {
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
