//! Batches: small meshes that a file places once, gathered by place into assets of their own. A batch is one progressive
//! mesh, so its members share a base mesh, an index and adaptive models.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DMat4, DVec3};
use lodestream_geometry::quantise::{DEFAULT_UV_BITS, MAX_POSITION_BITS, MAX_UV_BITS};
use lodestream_import::gltf::{Contents, join_uvs};
use lodestream_import::{BatchMember, Part};
use lodestream_scene::asset::MAX_MATERIALS;

/// Least number of meshes worth gathering: a few assets cost little.
const MIN_MEMBERS: usize = 32;
/// Most faces of a mesh in a batch. Larger meshes are refined well by themselves.
const MAX_MEMBER_FACES: usize = 8_192;
/// Most faces of a batch. A base mesh costs some 12 kB, whatever it stands for: that of a larger batch is cheaper, but
/// shows shards of its members at first.
const MAX_FACES: usize = 49_152;
/// Most meshes of a batch of a file with more materials than an asset may have: each has at most four.
const MAX_MEMBERS: usize = MAX_MATERIALS / 4;
/// Position steps over a member of median size.
const MEMBER_STEPS: f64 = 16_384.0;
/// Steps of texture coordinates over a repeat of a texture, at least: a texel of the largest usual textures.
const UV_STEPS: f64 = 4_096.0;

/// Meshes that become one asset.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Batch {
    /// Its members, in the order of the file.
    pub(super) part: Part,
    /// Largest distance between a position and its grid point, in units of the file.
    pub(super) tolerance: f64,
    /// Bits of texture coordinates; `None` for the default, where no member has a texture.
    pub(super) uv_bits: Option<u8>,
}

/// A mesh that may be in a batch.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    /// Index among the placed meshes.
    placed: usize,
    member: BatchMember,
    faces: usize,
    low: DVec3,
    high: DVec3,
    uvs: Option<[[f64; 2]; 2]>,
}

impl Candidate {
    fn center(&self) -> DVec3 {
        (self.low + self.high) / 2.0
    }
}

/// The batches of a file's meshes, and the placed meshes (by index) that are in one.
pub(super) fn of_contents(contents: &Contents) -> (Vec<Batch>, Vec<bool>) {
    let mut uses: BTreeMap<usize, usize> = BTreeMap::new();
    for placed in &contents.placed {
        if let Part::Mesh { mesh, .. } = placed.part {
            *uses.entry(mesh).or_default() += 1;
        }
    }
    let candidate = |(number, placed): (usize, &lodestream_import::gltf::PlacedMesh)| {
        let Part::Mesh { mesh, .. } = placed.part else { return None };
        let size = contents.sizes.get(mesh).copied().flatten()?;
        if uses.get(&mesh) != Some(&1) || size.faces == 0 || size.faces > MAX_MEMBER_FACES {
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
        let member = BatchMember { mesh, to_scene: placed.to_scene };
        Some(Candidate { placed: number, member, faces: size.faces, low, high, uvs: size.uvs })
    };
    let candidates: Vec<Candidate> = contents.placed.iter().enumerate().filter_map(candidate).collect();
    let mut batched = vec![false; contents.placed.len()];
    if candidates.len() < MIN_MEMBERS {
        return (Vec::new(), batched);
    }
    candidates.iter().for_each(|candidate| batched[candidate.placed] = true);
    let mut batches = Vec::new();
    let max_members = if contents.materials <= MAX_MATERIALS { usize::MAX } else { MAX_MEMBERS };
    split(candidates, max_members, &mut batches);
    (batches, batched)
}

/// Splits candidates in two at the middle of their faces along the longest side of their centres' bounds, until each part
/// is small enough for a batch.
fn split(mut candidates: Vec<Candidate>, max_members: usize, batches: &mut Vec<Batch>) {
    let faces: usize = candidates.iter().map(|candidate| candidate.faces).sum();
    if candidates.len() == 1 || (faces <= MAX_FACES && candidates.len() <= max_members) {
        return batches.push(batch(candidates));
    }
    let centers = || candidates.iter().map(Candidate::center);
    let low = centers().reduce(DVec3::min).unwrap_or_default();
    let high = centers().reduce(DVec3::max).unwrap_or_default();
    let axis = (high - low)
        .to_array()
        .into_iter()
        .enumerate()
        .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
    let axis = axis.map_or(0, |(axis, _)| axis);
    candidates.sort_by(|a, b| a.center()[axis].total_cmp(&b.center()[axis]).then(a.placed.cmp(&b.placed)));
    let mut before = 0;
    let middle = candidates.iter().position(|candidate| {
        before += candidate.faces;
        2 * before >= faces
    });
    let middle = middle.map_or(1, |at| at + 1).clamp(1, candidates.len() - 1);
    let rest = candidates.split_off(middle);
    split(candidates, max_members, batches);
    split(rest, max_members, batches);
}

fn batch(mut candidates: Vec<Candidate>) -> Batch {
    candidates.sort_by_key(|candidate| candidate.placed);
    let low = candidates.iter().map(|candidate| candidate.low).reduce(DVec3::min).unwrap_or_default();
    let high = candidates.iter().map(|candidate| candidate.high).reduce(DVec3::max).unwrap_or_default();
    let mut sizes: Vec<f64> =
        candidates.iter().map(|candidate| (candidate.high - candidate.low).max_element()).collect();
    sizes.sort_by(f64::total_cmp);
    // A cell is twice the tolerance wide. The grid has a limited number of cells, of which one is left over.
    let finest = (high - low).max_element() / f64::from(1_u32 << (MAX_POSITION_BITS - 1));
    let tolerance = (sizes[sizes.len() / 2] / MEMBER_STEPS / 2.0).max(finest).max(f64::MIN_POSITIVE);
    let members: Arc<[BatchMember]> = candidates.iter().map(|candidate| candidate.member).collect();
    let uvs = candidates.iter().map(|candidate| candidate.uvs).reduce(join_uvs).flatten();
    Batch { part: Part::Batch(members), tolerance, uv_bits: uvs.map(uv_bits) }
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
    use std::collections::BTreeSet;

    use data_encoding::BASE64;
    use lodestream_import::gltf::{MeshSize, PlacedMesh};
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
            PlacedMesh { part, placement: Placement::default(), to_scene }
        };
        Contents {
            names: Vec::new(),
            sizes: faces.iter().map(size).collect(),
            materials,
            placed: (0..faces.len()).map(placed).collect(),
            punctual_lights: Vec::new(),
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
        // The sixth mesh is placed twice.
        some.placed.push(some.placed[5].clone());
        let (batches, batched) = of_contents(&some);
        let alone: Vec<usize> = (0..41).filter(|&placed| !batched[placed]).collect();
        assert_eq!(alone, [3, 4, 5, 40]);
        assert_eq!(batches.len(), 1);
        assert_eq!(members(&batches[0]).len(), 37);
        assert_eq!(batches[0].tolerance, 1.0 / MEMBER_STEPS / 2.0);
        // Too few are left as they are.
        let (batches, batched) = of_contents(&contents(&[100; MIN_MEMBERS - 1], 1));
        assert!(batches.is_empty() && !batched.contains(&true));
    }

    #[test]
    fn texture_coordinates_have_a_grid_that_holds_all_members_at_the_usual_precision() {
        let bits = |ranges: &[Option<[[f64; 2]; 2]>]| {
            let mut some = contents(&[100; 32], 1);
            for (size, uvs) in some.sizes.iter_mut().zip(ranges) {
                size.as_mut().unwrap().uvs = *uvs;
            }
            of_contents(&some).0[0].uv_bits
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
        let faces = MAX_MEMBER_FACES / 4;
        let count = 2 * MAX_FACES / faces + 2;
        let (batches, _) = of_contents(&contents(&vec![faces; count], 1));
        let all: Vec<usize> = batches.iter().flat_map(members).collect();
        assert_eq!(all, (0..count).collect::<Vec<_>>(), "parts along x, one after another");
        assert!(batches.len() == 4 && batches.iter().all(|batch| members(batch).len() * faces <= MAX_FACES));
        let (batches, _) = of_contents(&contents(&vec![1; 2 * MAX_MEMBERS + 2], MAX_MATERIALS + 1));
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
            nodes.push(json!({"mesh": mesh, "translation": [4.0 * mesh as f64, 0.0, 0.0]}));
        }
        let children: Vec<usize> = (0..count).collect();
        nodes.push(json!({"translation": [408_000.0, 0.0, -4_080_000.0], "children": children}));
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
