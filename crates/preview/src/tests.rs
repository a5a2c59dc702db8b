use std::io::Read as _;
use std::sync::OnceLock;

use flate2::read::DeflateDecoder;
use glam::Vec3;
use lodestream_geometry::Settings;
use lodestream_geometry::mesh::{Corner, SourceMesh};
use lodestream_geometry::pool::{Serial, Silent};
use lodestream_geometry::prepare::Prepared;
use lodestream_geometry::quantise::{QuantiseSettings, quantise};
use lodestream_scene::asset::{Alpha, Material};
use lodestream_scene::description::{Camera, SceneLighting};
use lodestream_scene::proxy::Proxy;
use lodestream_scene::terrain::{TerrainEntry, Water};
use lodestream_terrain::{Parameters, Scratch, Terrain};

use super::*;

/// A preview as the script reads it.
struct Decoded {
    head: Value,
    bytes: Vec<u8>,
    at: usize,
}

impl Decoded {
    fn of(file: &[u8]) -> Self {
        let mut bytes = Vec::new();
        DeflateDecoder::new(file).read_to_end(&mut bytes).unwrap();
        let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        let head = serde_json::from_slice(&bytes[4..4 + length]).unwrap();
        Self { head, bytes, at: 4 + length }
    }

    fn coded(&mut self, count: usize) -> Vec<u16> {
        let planes = &self.bytes[self.at..self.at + 2 * count];
        self.at += 2 * count;
        (0..count).map(|i| u16::from_le_bytes([planes[i], planes[count + i]])).collect()
    }

    fn numbers(&mut self, count: usize) -> Vec<u16> {
        let mut before = 0_u16;
        let sum = |code: u16| {
            before = before.wrapping_add((code >> 1) ^ 0_u16.wrapping_sub(code & 1));
            before
        };
        self.coded(count).into_iter().map(sum).collect()
    }

    fn corners(&mut self, count: usize, next: &mut u16) -> Vec<u16> {
        let corner = |distance: u16| {
            let corner = next.wrapping_sub(distance);
            *next += u16::from(distance == 0);
            corner
        };
        self.coded(count).into_iter().map(corner).collect()
    }

    /// Positions of all corners of a mesh, in the asset's units.
    fn mesh(&mut self, mesh: &Value) -> Vec<Vec3> {
        let number = |value: &Value| value.as_f64().unwrap();
        let vertices = mesh["vertices"].as_u64().unwrap() as usize;
        let [x, y, z] = [(); 3].map(|()| self.numbers(vertices));
        if mesh["flat"] == false {
            self.numbers(2 * vertices);
        }
        if mesh["colored"] == true {
            self.numbers(3 * vertices);
        }
        let step = number(&mesh["step"]);
        let at = |axis: usize, part: u16| (number(&mesh["start"][axis]) + step * f64::from(part)) as f32;
        let point = |i: u16| {
            let i = usize::from(i);
            Vec3::new(at(0, x[i]), at(1, y[i]), at(2, z[i]))
        };
        let mut next = 0;
        let groups = mesh["groups"].as_array().unwrap().clone();
        let faces = groups
            .iter()
            .flat_map(|group| self.corners(3 * group["faces"].as_u64().unwrap() as usize, &mut next));
        let corners: Vec<u16> = faces.collect();
        assert_eq!(usize::from(next), vertices, "each vertex has a corner");
        corners.into_iter().map(point).collect()
    }
}

/// Quads along a side of the test surface.
const SIDE: u32 = 48;

/// A bumpy square, two units wide.
fn hills() -> &'static Prepared {
    static PREPARED: OnceLock<Prepared> = OnceLock::new();
    PREPARED.get_or_init(|| {
        let mut mesh = SourceMesh::default();
        for y in 0..=SIDE {
            for x in 0..=SIDE {
                let [u, v] = [x, y].map(|at| f64::from(at) / f64::from(SIDE));
                mesh.positions.push([2.0 * u - 1.0, 0.3 * (9.0 * u).sin() * (7.0 * v).cos(), 2.0 * v - 1.0]);
            }
        }
        for y in 0..SIDE {
            for x in 0..SIDE {
                let corner = |dx, dy| Corner::at((y + dy) * (SIDE + 1) + x + dx);
                mesh.faces.push([corner(0, 0), corner(0, 1), corner(1, 1)]);
                mesh.faces.push([corner(0, 0), corner(1, 1), corner(1, 0)]);
                mesh.materials.extend([0, 0]);
            }
        }
        let mesh = quantise(&mesh, &QuantiseSettings::default()).unwrap();
        let settings = Settings { region_faces: 300, ..Settings::default() };
        let mut prepared = lodestream_compress::prepare(&mesh, &settings, &Serial, &Silent).unwrap();
        prepared.base.description =
            described(Material { base_color: [0.5, 0.25, 0.125, 1.0], ..Material::default() });
        prepared
    })
}

fn described(material: Material) -> Vec<u8> {
    AssetDescription { materials: vec![material], ..AssetDescription::default() }.encode().unwrap()
}

fn header() -> SceneHeader {
    SceneHeader {
        name: "hills".into(),
        fingerprint: [7; 16],
        asset_count: 2,
        instance_count: 2,
        page_count: 1,
        light: SceneLighting { direction: [0.0, 1.0, 0.0], color: [1.0; 3], ambient: [0.2; 3] },
        background: [0.1; 3],
        terrain: None,
        camera: Camera { eye: [0.0, 2.0, 3.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 0.9 },
        root_slope: 0.0,
    }
}

/// Two assets of the test mesh, one of them far away.
fn page(prepared: &Prepared) -> ScenePage {
    let entry = AssetEntry {
        origin: prepared.base.grid.origin,
        sphere: prepared.base.sphere,
        base_bytes: 1000,
        chunk_count: prepared.base.chunk_count,
        ..AssetEntry::default()
    };
    let instances = vec![Instance::at(0, [0.0; 3]), Instance::at(1, [0.0, 0.0, -5000.0])];
    ScenePage { assets: vec![entry; 2], instances, ..ScenePage::default() }
}

fn blob(prepared: &Prepared, part: BlobPart) -> Option<Vec<u8>> {
    match part {
        BlobPart::Base => lodestream_compress::encode_base(&prepared.base).ok(),
        BlobPart::IndexPage(page) => prepared.pages.get(page as usize).cloned(),
        BlobPart::Chunk(chunk) => prepared.chunks.get(chunk as usize).cloned(),
        BlobPart::Texture { .. } | BlobPart::TextureRegions | BlobPart::Tile(_) => None,
    }
}

fn preview(header: &SceneHeader, page: &ScenePage, prepared: &Prepared) -> Result<Vec<u8>, PreviewError> {
    encode(header, &[page], |_, part| Ok(blob(prepared, part)))
}

#[test]
fn near_meshes_are_refined_and_all_stay_within_a_step() {
    let (prepared, page) = (hills(), page(hills()));
    let file = preview(&header(), &page, prepared).unwrap();
    assert_eq!(file, preview(&header(), &page, prepared).unwrap());
    let mut decoded = Decoded::of(&file);
    let meshes = decoded.head["meshes"].as_array().unwrap().clone();
    let [near, far] = [&meshes[0], &meshes[1]].map(|mesh| decoded.mesh(mesh));
    assert_eq!(decoded.at, decoded.bytes.len());
    assert_eq!(far.len(), 3 * prepared.base.faces.len(), "no chunk is worth its bytes far away");
    assert!(near.len() > 2 * far.len(), "{} {}", near.len(), far.len());
    // Each corner is near the surface that the mesh was made from, within the base mesh's error for the far one.
    let height = |at: Vec3| {
        let [u, v] = [at.x, at.z].map(|at| (at + 1.0) / 2.0);
        0.3 * (9.0 * u).sin() * (7.0 * v).cos()
    };
    let step = meshes[0]["step"].as_f64().unwrap() as f32;
    assert!(step < 2.1 / STEPS_OF_TEST, "{step}");
    let worst = near.iter().map(|at| (at.y - height(*at)).abs()).fold(0.0, f32::max);
    assert!(worst < 0.05, "{worst}");
    assert_eq!(
        decoded.head["instances"],
        json!([[0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0], [1, 0.0, 0.0, -5000.0, 0.0, 0.0, 0.0, 1.0, 1.0]])
    );
    assert_eq!(meshes[0]["groups"][0]["look"]["color"], json!([0.5, 0.25, 0.125]));
}

#[test]
fn proxies_are_left_out_however_many_come_first() {
    let (prepared, placed) = (hills(), page(hills()));
    let count = MAX_ASSETS as u32 + 1;
    let proxies = (0..count).map(|asset| Proxy { asset, instance_count: 2, ..Proxy::default() }).collect();
    let first =
        ScenePage { assets: vec![placed.assets[0].clone(); count as usize], proxies, ..ScenePage::default() };
    let mut then = ScenePage { first_asset: count, ..placed.clone() };
    then.instances.iter_mut().for_each(|instance| instance.asset += count);
    let file = encode::<PreviewError>(&header(), &[first, then], |asset, part| {
        assert!(asset >= count);
        Ok(blob(prepared, part))
    });
    assert_eq!(file.unwrap(), preview(&header(), &placed, prepared).unwrap());
}

/// Positions have 12 bits.
const STEPS_OF_TEST: f32 = 4095.0;

#[test]
fn a_scene_without_anything_to_show_has_no_preview() {
    let prepared = hills();
    let mut page = page(prepared);
    let none = encode::<PreviewError>(&header(), &[&page], |_, _| Ok(None));
    assert!(matches!(none, Err(PreviewError::Empty)));
    // A base blob that is too long is not read.
    page.assets.iter_mut().for_each(|entry| entry.base_bytes = MAX_BASE_BYTES + 1);
    assert!(matches!(preview(&header(), &page, prepared), Err(PreviewError::Empty)));
    let glass = Material { base_color: [1.0, 1.0, 1.0, 0.2], alpha: Alpha::Blend, ..Material::default() };
    let mut clear =
        Prepared { base: prepared.base.clone(), infos: Vec::new(), pages: Vec::new(), chunks: Vec::new() };
    clear.base.description = described(glass);
    page.assets.iter_mut().for_each(|entry| entry.base_bytes = 1000);
    assert!(matches!(preview(&header(), &page, &clear), Err(PreviewError::Empty)));
}

#[test]
fn damaged_blobs_are_errors_or_end_the_refinement() {
    let (prepared, page) = (hills(), page(hills()));
    let bad = |of: fn(BlobPart) -> bool| {
        encode::<PreviewError>(&header(), &[&page], |_, part| {
            let whole = blob(prepared, part);
            Ok(if of(part) { whole.map(|bytes| bytes[..bytes.len() / 2].to_vec()) } else { whole })
        })
    };
    let why = bad(|part| part == BlobPart::Base).unwrap_err();
    assert!(why.to_string().starts_with("base mesh of asset 0: "), "{why}");
    for of in [|part| part == BlobPart::IndexPage(0), |part| matches!(part, BlobPart::Chunk(_))] {
        let file = bad(of).unwrap();
        let mut decoded = Decoded::of(&file);
        let mesh = decoded.head["meshes"][0].clone();
        assert_eq!(decoded.mesh(&mesh).len(), 3 * prepared.base.faces.len());
    }
}

#[test]
fn the_ground_is_that_of_the_terrain_and_never_above_it_near_the_camera() {
    let parameters =
        Parameters { seed: 7, finest_level: 6, extent_log2: 8, amplitude: 4000, ..Parameters::default() };
    let entry = TerrainEntry {
        parameters,
        unit: 0.5,
        height_unit: 0.01,
        zones: [0.0, 120.0, 300.0],
        stamps: Vec::new(),
        patches: 0,
        water: Some(Water { level: -4.0, clarity: 6.0 }),
    };
    let header = SceneHeader { terrain: Some(Box::new(entry)), ..header() };
    let mut decoded = Decoded::of(&preview(&header, &page(hills()), hills()).unwrap());
    for mesh in decoded.head["meshes"].as_array().unwrap().clone() {
        decoded.mesh(&mesh);
    }
    let ground = decoded.head["ground"].clone();
    let number = |name: &str| ground[name].as_f64().unwrap();
    let (rings, side) = (number("rings") as usize, number("side") as usize);
    let heights = decoded.numbers(rings * 4 * side);
    assert_eq!(decoded.at, decoded.bytes.len());
    assert_eq!(ground["water"], json!(-4.0));
    let terrain = Terrain::new(parameters).unwrap();
    let mut half = number("inner");
    for ring in 0..rings {
        // The corner from which points are counted.
        let [x, z] = [header.camera.eye[0] + half, header.camera.eye[2] - half].map(|at| at / 0.5);
        let expected = terrain.height_between(x, z, &mut Scratch::new()) * f64::from(0.01_f32);
        let height = number("low") + number("step") * f64::from(heights[ring * 4 * side]);
        let near = half < 3.0 * 13.0_f64.sqrt();
        assert!(height <= expected + number("step"), "{ring}: {height} {expected}");
        assert!(near || (height - expected).abs() <= number("step"), "{ring}: {height} {expected}");
        half *= number("ratio");
    }
}
