//! Published scenes.

use std::path::Path;

use lodestream_bake::compose::compose;
use lodestream_bake::scene;
use lodestream_geometry::index::{self, ChunkInfo, Sphere, TruncationPoint};
use lodestream_scene::description::AssetEntry;
use lodestream_scene::published::{
    ChunkPlace, ChunkTable, IndexPage, PackContents, Texture, TexturePlace, TileLevel, TilePlace, TileTable,
    Tiles, part_hash,
};
use lodestream_store::SceneObject;

use super::seed::seed;

fn published_chunk(n: u32) -> ChunkInfo {
    let point = TruncationPoint { payload_bytes: 20, error: 0.5, vertices: 1, wedges: 1, faces: 1 };
    ChunkInfo {
        level: 1,
        sphere: Sphere { center: [0.0; 3], radius: 1.0 },
        error: 1.0,
        attribute_error: 0.0,
        truncation_points: if n.is_multiple_of(2) { vec![point] } else { Vec::new() },
        parents: Vec::new(),
        payload_bytes: 40 + n,
        vertices: 2,
        wedges: 2,
        faces: 2,
    }
}

/// What a published scene holds of a pack with chunks and textures.
fn published_pack(asset: &AssetEntry) -> PackContents {
    let infos: Vec<ChunkInfo> = (0..asset.chunk_count).map(published_chunk).collect();
    let place = |info: &ChunkInfo| ChunkPlace::of(info).hashed(&vec![5; info.payload_bytes as usize]);
    let chunks = infos.iter().map(|info| place(info).expect("the length is the index's"));
    let chunks = ChunkTable { offset: 300, chunks: chunks.collect() };
    let texture = |level: u8| {
        let bytes = vec![level; 9];
        let place = TexturePlace { texture: 0, level, bytes: 9, hash: part_hash(&bytes) };
        Texture { place, copy: (level == 0).then(|| bytes.into()) }
    };
    PackContents {
        key: [asset.fingerprint[0]; 32],
        bytes: 4096,
        base: vec![3; asset.base_bytes as usize].into(),
        index: vec![IndexPage {
            bytes: index::encode_page(&infos, 0).expect("chunks are indexed").into(),
            chunks,
        }],
        textures_offset: 2000,
        textures: vec![texture(0), texture(1)],
        tiles: Some(Tiles {
            regions: vec![7; 12].into(),
            table: TileTable {
                offset: 2018,
                levels: vec![TileLevel {
                    texture: 0,
                    level: 2,
                    tiles: vec![TilePlace { bytes: 20, hash: [1, 2, 3, 4] }; 4],
                }],
            },
        }),
    }
}

/// Scenes with the directories of made-up packs.
pub(super) fn published() -> Vec<(String, Vec<u8>)> {
    let assets = "[[asset]]\nname = 'a'\nfile = 'a.obj'\n[[asset]]\nname = 'b'\nfile = 'b.obj'\n";
    let places = |count: usize| -> String {
        let place = |n: usize| {
            format!("[[instance]]\nasset = '{}'\ntranslation = [{n}, 0, 0.5]\n", ["a", "b"][n % 2])
        };
        (0..count).map(place).collect()
    };
    let punctual_lights =
        |count: usize| "[[punctual_light]]\nposition = [0, 2, 0]\nintensity = 40\n".repeat(count);
    let object = |text: String| {
        let scene = scene::parse(Path::new("scene.toml"), &text).expect("the text is a scene");
        let entry = |(n, asset): (u8, &scene::Asset)| AssetEntry {
            name: asset.name.clone(),
            fingerprint: [n; 16],
            sphere: Sphere { center: [0.0; 3], radius: 1.0 },
            root_error: 0.1,
            base_bytes: 100,
            chunk_count: 3,
            ..AssetEntry::default()
        };
        let entries: Vec<_> = (1..).zip(&scene.assets).map(entry).collect();
        let description = compose(&scene, &entries, &[Vec::new(), Vec::new()]).expect("it can be described");
        let assets = description.pages.iter().flat_map(|page| &page.assets);
        let packs = assets.map(published_pack).collect();
        SceneObject { description, packs }.encode().expect("a scene is encoded")
    };
    vec![
        seed("one", object(format!("{assets}{}", places(1)))),
        seed("two", object(format!("{assets}{}", places(2)))),
        seed("pages", object(format!("{assets}{}", places(150)))),
        seed("punctual_lights", object(format!("{assets}{}{}", places(2), punctual_lights(3)))),
        seed("streets", object(format!("{assets}{}{}", places(1), punctual_lights(300)))),
        seed(
            "ground",
            object(format!(
                "{assets}{}[terrain]\nseed = 7\npatch_cells = 64\npatches = 4\namplitude = 30\n",
                places(2)
            )),
        ),
    ]
}
