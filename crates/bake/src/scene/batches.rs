//! Batches: small meshes that a file places once, or a few times, gathered by place into assets of their own. A batch is
//! one progressive mesh, so its members share a base mesh, an index and adaptive models.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{DMat4, DVec3};
use lodestream_geometry::quantise::{DEFAULT_UV_BITS, MAX_POSITION_BITS, MAX_UV_BITS};
use lodestream_import::gltf::{Contents, PlacedMesh, join_uvs};
use lodestream_import::{BatchMember, Part};
use lodestream_scene::asset::MAX_MATERIALS;

use super::split::{self, Candidate};
use crate::preparation_settings::Batching;

/// Least number of meshes worth gathering: a few assets cost little.
const MIN_MEMBERS: usize = 32;
/// Most faces of a mesh in a batch. Larger meshes are refined well by themselves.
const MAX_MEMBER_FACES: usize = 8_192;
/// Most meshes of a batch of a file with more materials than an asset may have: each has at most four.
const MAX_MEMBERS: usize = MAX_MATERIALS / 4;
/// Position steps over the smallest member.
const MEMBER_STEPS: f64 = 16_384.0;
/// Steps of texture coordinates over a repeat of a texture, at least: a texel of the largest usual textures.
const UV_STEPS: f64 = 4_096.0;

/// Bytes of an asset, besides its faces…
const ASSET_BYTES: f64 = 390.0;
/// …of each instance, some 13, and more as pages come before what they list (docs/design/batches.md)…
const INSTANCE_BYTES: f64 = 16.0;
/// …of a member of a batch that repeats another, besides its faces…
const MEMBER_BYTES: f64 = 10.0;
/// …and of a face in either.
const FACE_BYTES: f64 = 1.2;

/// Meshes that become one asset.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Batch {
    /// Its members, in the order of the file.
    pub(super) part: Part,
    /// Largest distance between a position and its grid point, in units of the file.
    pub(super) tolerance: f64,
    /// Index of each member among the placed meshes.
    pub(super) placed: Vec<usize>,
    /// Bits of texture coordinates; `None` for the default, where no member has a texture.
    pub(super) uv_bits: Option<u8>,
}

/// The batches of a file's meshes, and the placed meshes (by index) that are in one. Meshes that move are in none.
pub(super) fn of_contents(contents: &Contents, batching: Batching) -> (Vec<Batch>, Vec<bool>) {
    let mut batched = vec![false; contents.placed.len()];
    let Some(max_faces) = batching.faces() else { return (Vec::new(), batched) };
    // Copies share a part. Parts with numbers that are equal are equal, whatever their signs of zero.
    let mut uses: BTreeMap<(usize, [u64; 9]), usize> = BTreeMap::new();
    let key = |placed: &PlacedMesh| match &placed.part {
        Part::Mesh { mesh, linear } => {
            let mut bits = [0; 9];
            bits.iter_mut().zip(linear.iter().flatten()).for_each(|(bits, x)| *bits = (x + 0.0).to_bits());
            Some((*mesh, bits))
        }
        Part::Whole | Part::Batch(_) => None,
    };
    for placed in &contents.placed {
        let Some(key) = key(placed) else { continue };
        *uses.entry(key).or_default() += 1;
    }
    let moving: BTreeSet<usize> =
        contents.animation.iter().flat_map(|animation| &animation.placed).copied().collect();
    let candidate = |(number, placed): (usize, &PlacedMesh)| {
        if moving.contains(&number) {
            return None;
        }
        let size = contents.sizes.get(placed.mesh).copied().flatten()?;
        let places = key(placed).and_then(|key| uses.get(&key)).copied()?;
        if size.faces == 0 || size.faces > MAX_MEMBER_FACES || instances_pay(places, size.faces) {
            return None;
        }
        let to_scene = DMat4::from_cols_array_2d(&placed.to_scene);
        let corner = |i: usize| {
            let [x, y, z] =
                [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { size.low[axis] } else { size.high[axis] });
            to_scene.transform_point3(DVec3::new(x, y, z))
        };
        let low = (0..8).map(corner).reduce(DVec3::min)?;
        let high = (0..8).map(corner).reduce(DVec3::max)?;
        let member = BatchMember { mesh: placed.mesh, to_scene: placed.to_scene };
        Some(Candidate { placed: number, member, faces: size.faces, low, high, uvs: size.uvs })
    };
    let candidates: Vec<Candidate> = contents.placed.iter().enumerate().filter_map(candidate).collect();
    if candidates.len() < MIN_MEMBERS {
        return (Vec::new(), batched);
    }
    candidates.iter().for_each(|candidate| batched[candidate.placed] = true);
    let max_members = if contents.materials <= MAX_MATERIALS { usize::MAX } else { MAX_MEMBERS };
    let groups = split::by_place(candidates, max_faces, max_members);
    (groups.into_iter().map(batch).collect(), batched)
}

/// Whether a mesh that stands in several places costs fewer bytes as an asset with instances than as a member of batches
/// once for each place.
fn instances_pay(places: usize, faces: usize) -> bool {
    let (count, faces) = (places as f64, faces as f64 * FACE_BYTES);
    count > 1.0 && ASSET_BYTES + faces + INSTANCE_BYTES * count < (MEMBER_BYTES + faces) * count
}

fn batch(mut candidates: Vec<Candidate>) -> Batch {
    candidates.sort_by_key(|candidate| candidate.placed);
    let low = candidates.iter().map(|candidate| candidate.low).reduce(DVec3::min).unwrap_or_default();
    let high = candidates.iter().map(|candidate| candidate.high).reduce(DVec3::max).unwrap_or_default();
    // A cell is twice the tolerance wide. The grid has a limited number of cells, of which one is left over.
    let finest = (high - low).max_element() / f64::from(1_u32 << (MAX_POSITION_BITS - 1));
    let sizes = candidates.iter().map(|candidate| (candidate.high - candidate.low).max_element());
    let least = sizes.filter(|size| *size > 0.0).reduce(f64::min).unwrap_or(0.0);
    let tolerance = (least / MEMBER_STEPS / 2.0).max(finest).max(f64::MIN_POSITIVE);
    let members: Arc<[BatchMember]> = candidates.iter().map(|candidate| candidate.member).collect();
    let placed = candidates.iter().map(|candidate| candidate.placed).collect();
    let uvs = candidates.iter().map(|candidate| candidate.uvs).reduce(join_uvs).flatten();
    Batch { part: Part::Batch(members), tolerance, placed, uv_bits: uvs.map(uv_bits) }
}

/// Bits of a grid over a range of texture coordinates, of at most 16 repeats, with as many steps over a repeat as the
/// default has over the whole of a texture.
fn uv_bits([low, high]: [[f64; 2]; 2]) -> u8 {
    let extent = (high[0] - low[0]).max(high[1] - low[1]);
    (DEFAULT_UV_BITS..MAX_UV_BITS)
        .find(|&bits| extent * UV_STEPS <= f64::from(1_u32 << bits))
        .unwrap_or(MAX_UV_BITS)
}

#[cfg(test)]
mod tests {
    use data_encoding::BASE64;
    use lodestream_import::gltf::MeshSize;
    use lodestream_scene::placement::Placement;
    use serde_json::{Value, json};

    use super::*;
    use crate::prepare::{Options, prepare_cached};
    use crate::scene::{Asset, Scene, of_files};

    /// A mesh of a number of faces and of unit size, placed along x.
    fn contents(faces: &[usize], materials: usize) -> Contents {
        let size = |&faces: &usize| Some(MeshSize { faces, low: [0.0; 3], high: [1.0; 3], uvs: None });
        let placed = |mesh: usize| {
            let to_scene =
                DMat4::from_translation(DVec3::new(3.0 * mesh as f64, 0.0, 0.0)).to_cols_array_2d();
            let part = Part::Mesh { mesh, linear: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] };
            PlacedMesh { part, placement: Placement::default(), mesh, to_scene, node: None }
        };
        Contents {
            names: Vec::new(),
            sizes: faces.iter().map(size).collect(),
            part_names: Arc::default(),
            materials,
            warnings: Vec::new(),
            placed: (0..faces.len()).map(placed).collect(),
            punctual_lights: Vec::new(),
            animation: None,
        }
    }

    fn members(batch: &Batch) -> Vec<usize> {
        let Part::Batch(members) = &batch.part else { panic!("no batch") };
        members.iter().map(|member| member.mesh).collect()
    }

    #[test]
    fn small_meshes_that_are_placed_once_are_gathered_by_place() {
        let mut some = contents(&[100; 40], 1);
        some.sizes[3] = None;
        some.sizes[4].as_mut().unwrap().faces = MAX_MEMBER_FACES + 1;
        // The sixth mesh is placed often.
        (0..8).for_each(|_| some.placed.push(some.placed[5].clone()));
        let (batches, batched) = of_contents(&some, Batching::Auto);
        let alone: Vec<usize> = (0..48).filter(|&placed| !batched[placed]).collect();
        assert_eq!(alone, [3, 4, 5, 40, 41, 42, 43, 44, 45, 46, 47]);
        assert_eq!(batches.len(), 1);
        assert_eq!(members(&batches[0]).len(), 37);
        assert_eq!(batches[0].tolerance, 1.0 / MEMBER_STEPS / 2.0);
        // One half as large.
        let half = some.sizes[7].as_mut().unwrap();
        half.high = [0, 1, 2].map(|axis| f64::midpoint(half.low[axis], half.high[axis]));
        assert_eq!(of_contents(&some, Batching::Auto).0[0].tolerance, 0.5 / MEMBER_STEPS / 2.0);
        // Too few are left as they are.
        let (batches, batched) = of_contents(&contents(&[100; MIN_MEMBERS - 1], 1), Batching::Auto);
        assert!(batches.is_empty() && !batched.contains(&true));
    }

    #[test]
    fn texture_coordinates_have_a_grid_that_holds_all_members_at_the_usual_precision() {
        let bits = |ranges: &[Option<[[f64; 2]; 2]>]| {
            let mut some = contents(&[100; 32], 1);
            for (size, uvs) in some.sizes.iter_mut().zip(ranges) {
                size.as_mut().unwrap().uvs = *uvs;
            }
            of_contents(&some, Batching::Auto).0[0].uv_bits
        };
        assert_eq!(bits(&[None, None]), None);
        assert_eq!(bits(&[None, Some([[0.0, 0.0], [1.0, 0.5]])]), Some(DEFAULT_UV_BITS));
        let far = [Some([[-8.0, 0.0], [-7.0, 1.0]]), Some([[7.0, 0.0], [8.0, 1.0]])];
        assert_eq!(bits(&far[..1]), Some(DEFAULT_UV_BITS));
        assert_eq!(bits(&far), Some(MAX_UV_BITS));
        assert_eq!(bits(&[Some([[0.0, -1.0], [1.0, 1.5]])]), Some(14));
    }

    #[test]
    fn large_batches_are_split_where_their_meshes_are() {
        let max_faces = Batching::Auto.faces().unwrap();
        let faces = MAX_MEMBER_FACES / 4;
        let count = 2 * max_faces / faces + 2;
        let (batches, _) = of_contents(&contents(&vec![faces; count], 1), Batching::Auto);
        let all: Vec<usize> = batches.iter().flat_map(members).collect();
        assert_eq!(all, (0..count).collect::<Vec<_>>(), "parts along x, one after another");
        assert!(batches.len() == 3 && batches.iter().all(|batch| members(batch).len() * faces <= max_faces));
        let (batches, _) =
            of_contents(&contents(&vec![1; 2 * MAX_MEMBERS + 2], MAX_MATERIALS + 1), Batching::Auto);
        assert!(batches.len() > 2 && batches.iter().all(|batch| members(batch).len() <= MAX_MEMBERS));
    }

    /// Meshes far from the origin, each a tetrahedron of its own height.
    fn write(folder: &std::path::Path, count: usize) -> std::path::PathBuf {
        let corner = |mesh: usize| 1.0 + mesh as f32 / 64.0;
        let mut bytes = Vec::new();
        let (mut views, mut accessors, mut meshes, mut nodes) = (vec![], vec![], vec![], vec![]);
        for mesh in 0..count {
            let high = corner(mesh);
            let corners = [[0.0, 0.0, 0.0], [high, 0.0, 0.0], [0.0, high, 0.0], [0.0, 0.0, high]];
            let faces: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
            let offset = bytes.len();
            for number in faces.iter().flatten().flat_map(|&corner| corners[corner]) {
                bytes.extend(f32::to_le_bytes(number));
            }
            views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len() - offset}));
            accessors.push(json!({
                "bufferView": mesh, "componentType": 5126, "type": "VEC3", "count": 12,
                "min": [0.0, 0.0, 0.0], "max": [high, high, high],
            }));
            meshes.push(json!({"primitives": [{"attributes": {"POSITION": mesh}}]}));
            let translation = [4.0 * mesh as f64, 0.0, 0.0];
            let extras = json!({"number": mesh});
            nodes.push(json!({"mesh": mesh, "name": format!("part {mesh}"), "translation": translation, "extras": extras}));
        }
        let children: Vec<usize> = (0..count).collect();
        nodes.push(
            json!({"name": "floor", "translation": [408_000.0, 0.0, -4_080_000.0], "children": children}),
        );
        let uri = format!("data:application/octet-stream;base64,{}", BASE64.encode(&bytes));
        let file: Value = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [count]}], "nodes": nodes, "meshes": meshes,
            "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": bytes.len(), "uri": uri}],
        });
        let path = folder.join("parts.gltf");
        std::fs::write(&path, file.to_string()).unwrap();
        path
    }

    #[test]
    fn a_batch_has_all_faces_of_its_members_in_their_places() {
        let folder = tempfile::tempdir().unwrap();
        let scene: Scene = of_files(&[write(folder.path(), 40)]).unwrap();
        let [asset]: &[Asset; 1] = scene.assets[..].try_into().unwrap();
        assert_eq!(asset.name, "parts/parts");
        let [instance] = scene.models[0].parts[..] else { panic!("one instance") };
        assert_eq!(instance.placement, Placement::default());
        let options = Options { quiet: true, ..Options::default() };
        let pack =
            prepare_cached(asset, &folder.path().join("cache"), &options).unwrap().pack.load().unwrap();
        let mesh = pack.refined(&pack.everything()).unwrap();
        assert_eq!(mesh.face_count(), 4 * 40);
        let (positions, _) = mesh.surface();
        // In steps of 1/64, of which the places are multiples; the tolerance is far below.
        let place = |at: DVec3| (at * 64.0).round().to_array().map(|x| x as i64);
        let origin = DVec3::from(mesh.grid().origin);
        let found: BTreeSet<_> =
            positions.iter().map(|&at| place(origin + glam::Vec3::from(at).as_dvec3())).collect();
        let expected: BTreeSet<_> = (0..40)
            .flat_map(|mesh| {
                let high = 1.0 + f64::from(mesh) / 64.0;
                let start = DVec3::new(408_000.0 + 4.0 * f64::from(mesh), 0.0, -4_080_000.0);
                [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|axis| place(start + axis * high))
            })
            .collect();
        assert!(found == expected, "{:?}", found.symmetric_difference(&expected).take(8).collect::<Vec<_>>());
    }
}
