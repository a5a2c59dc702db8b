//! Tiles of large textures.

use lodestream_scene::asset::{TexturePatch, TextureRegion, TextureRegions, tile_grid};
use lodestream_scene::blob::Tile;

use super::*;

/// Sides of the levels; the first two are whole.
const SIDES: [u32; 5] = [128, 256, 512, 1024, 2048];
/// Texels of a tile's page.
const PAGE: u64 = 260 * 260;

/// A plane of 2 units that a texture of 2048 texels covers once, in 8 × 8 regions.
fn tiled(entry: AssetEntry) -> AssetState {
    let level =
        |side: u32| TextureLevel { width: side, height: side, bytes: 4000, format: TextureFormat::WebP };
    let description = AssetDescription {
        name: "plane".into(),
        materials: vec![Material { base_color_texture: Some(0), ..Material::default() }],
        textures: vec![TextureInfo {
            kind: TextureKind::Color,
            width: 2048,
            height: 2048,
            planes: 0,
            mean: None,
            uv_per_unit: 0.5,
            levels: SIDES.map(level).to_vec(),
        }],
    };
    let mut asset = known_asset_of(entry, 1);
    asset.set_description(&description);
    asset
}

fn regions() -> TextureRegions {
    let region = |at: u16| {
        let [column, row] = [at % 8, at / 8].map(|at| 0.25 * (f32::from(at) + 0.5) - 1.0);
        TextureRegion {
            sphere: Sphere { center: [column, 0.0, row], radius: 0.18 },
            patches: vec![TexturePatch {
                material: 0,
                area: 0.0625,
                uv_per_unit: 0.5,
                cells: std::iter::once(at..at + 1).collect(),
            }],
        }
    };
    TextureRegions { low: [-1.0; 3], size: 2.0, regions: (0..64).map(region).collect() }
}

fn with_regions() -> AssetState {
    let mut asset = tiled(plane_entry("plane", &plane(1), 1000));
    asset.set_texture_regions(regions());
    asset
}

fn tiles(wanted: &[Wanted]) -> Vec<Tile> {
    let tile = |w: &Wanted| match w.id.part() {
        Some(BlobPart::Tile(tile)) => Some(tile),
        _ => None,
    };
    wanted.iter().filter_map(tile).collect()
}

fn here(asset: &AssetState, level: u8) -> Vec<u16> {
    let count = tile_grid([SIDES[usize::from(level)]; 2]).iter().product::<u32>() as u16;
    let applied =
        |tile: &u16| asset.state(BlobPart::Tile(Tile { texture: 0, level, tile: *tile })) == State::Applied;
    (0..count).filter(applied).collect()
}

#[test]
fn regions_are_wanted_where_whole_levels_are_too_coarse() {
    let wants = |distance: f64| {
        let assets = [tiled(plane_entry("plane", &plane(1), 1000))];
        let view = above([0.0, distance, 0.1]);
        let wanted = Selector::default().select(&view, &[Instance::at(0, [0.0; 3])], &assets).wanted.clone();
        wanted.iter().any(|w| w.id == BlobId::texture_regions(0))
    };
    // 256 texels are 2 units: 750 px per unit of tangent.
    assert!(wants(4.0));
    assert!(!wants(9.0));
}

#[test]
fn a_view_takes_the_tiles_that_it_shows_as_fine_as_they_are_seen() {
    let mut assets = [with_regions()];
    let instances = [Instance::at(0, [0.0; 3])];
    // The whole plane, some 500 pixels wide.
    settle(&mut Selector::default(), &above([0.0, 3.5, 0.1]), &instances, &mut assets);
    assert_eq!((here(&assets[0], 2).len(), here(&assets[0], 3).len()), (4, 0));
    // Close to a corner, where u and v are least.
    let close = View::look_at([-0.8, 0.25, -0.79], [-0.8, 0.0, -0.8], [0.0, 1.0, 0.0], 0.9, [1280, 720]);
    let mut assets = [with_regions()];
    settle(&mut Selector::default(), &close, &instances, &mut assets);
    let finest = here(&assets[0], 4);
    assert!(finest.contains(&0) && finest.len() <= 8, "{finest:?}");
    let column_and_row = |tile: &u16| (tile % 8, tile / 8);
    assert!(finest.iter().map(column_and_row).all(|(column, row)| column < 4 && row < 3), "{finest:?}");
    // What is finer has its coarser tiles.
    for level in 3..5 {
        let coarser = here(&assets[0], level - 1);
        let side = SIDES[usize::from(level)].div_ceil(256) as u16;
        for tile in here(&assets[0], level) {
            let below = (tile / side / 2) * (side / 2) + tile % side / 2;
            assert!(coarser.contains(&below), "tile {tile} of level {level}");
        }
    }
}

#[test]
fn tiles_out_of_view_and_behind_others_are_not_wanted() {
    let view = above([0.0, 3.5, 0.1]);
    let mut roof = AssetState::new(plane_entry("roof", &[], 1000));
    roof.set_state(BlobPart::Base, State::Applied);
    let corners = vec![[-2.0, 0.0, -2.0], [2.0, 0.0, -2.0], [2.0, 0.0, 2.0], [-2.0, 0.0, 2.0]];
    roof.set_occluder(std::sync::Arc::new(crate::Occluder::new(corners, vec![[0, 1, 2], [0, 2, 3]])));
    let mut floor = with_regions();
    let flat = vec![[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]];
    floor.set_occluder(std::sync::Arc::new(crate::Occluder::new(flat, vec![[0, 1, 2], [0, 2, 3]])));
    let assets = [floor, roof];
    let wanted = |height: f64, selector: &mut Selector| {
        let instances = [Instance::at(0, [0.0; 3]), Instance::at(1, [0.0, height, 0.0])];
        tiles(&selector.select(&view, &instances, &assets).wanted).len()
    };
    assert_eq!(wanted(1.5, &mut Selector::default()), 0, "below the roof");
    assert_eq!(wanted(-3.0, &mut Selector::default()), 4, "above it");
    let settings = SelectSettings { hidden_last: false, ..SelectSettings::default() };
    assert_eq!(wanted(1.5, &mut Selector::new(settings)), 4, "without the test");
    let away = View::look_at([0.0, 3.5, 0.1], [0.0, 9.0, 0.0], [0.0, 0.0, 1.0], 0.9, [1280, 720]);
    let selection = Selector::default().select(&away, &[Instance::at(0, [0.0; 3])], &assets).clone();
    assert_eq!(tiles(&selection.wanted), []);
}

#[test]
fn shared_tiles_are_wanted_once_and_their_differences_add_up() {
    let shared = vec![SharedTexture { texture: 0, asset: 0, of: 0 }];
    let mut second = tiled(AssetEntry { shared, ..plane_entry("plane", &plane(1), 1000) });
    second.set_texture_regions(regions());
    let assets = [with_regions(), second];
    let (one, two) = (Instance::at(0, [-1.2, 0.0, 0.0]), Instance::at(1, [1.2, 0.0, 0.0]));
    let view = above([0.0, 3.5, 0.1]);
    let wanted = |instances: &[Instance]| {
        let wanted = Selector::default().select(&view, instances, &assets).wanted.clone();
        wanted.into_iter().filter(|w| matches!(w.id.part(), Some(BlobPart::Tile(_)))).collect::<Vec<_>>()
    };
    let (alone, both) = (wanted(&[one]), wanted(&[one, two]));
    assert!(!alone.is_empty() && both.len() == alone.len());
    assert!(both.iter().all(|w| w.id.asset() == Some(0)));
    let priority = |wanted: &[Wanted]| wanted.iter().map(|w| w.priority).max();
    assert!(priority(&both) > priority(&alone));
}

#[test]
fn tiles_stay_within_their_bound_and_the_least_recently_seen_go_first() {
    // Room for the whole levels and twelve tiles.
    let room = 128 * 128 + 256 * 256 + 12 * PAGE;
    let mut selector = Selector::new(SelectSettings { max_texels: room, ..SelectSettings::default() });
    let mut assets = [with_regions()];
    let instances = [Instance::at(0, [0.0; 3])];
    let at =
        |x: f64, z: f64| View::look_at([x, 0.25, z + 0.01], [x, 0.0, z], [0.0, 1.0, 0.0], 0.9, [1280, 720]);
    let mut most = 0;
    for (x, z) in [(-0.8, -0.8), (0.8, 0.8), (0.8, -0.8), (-0.8, -0.8), (-0.8, 0.8)] {
        let view = at(x, z);
        settle(&mut selector, &view, &instances, &mut assets);
        let counters = selector.select(&view, &instances, &assets).counters;
        assert!(counters.texels <= room, "{} of {room}", counters.texels);
        assert!(counters.settled);
        most = most.max(counters.texels);
        // What the last view shows is there.
        let column_and_row = [x, z].map(|at| ((at + 1.0) * 4.0) as u16);
        assert!(here(&assets[0], 4).contains(&(8 * column_and_row[1] + column_and_row[0])), "{x} {z}");
    }
    assert!(most > room - 2 * PAGE, "all of it is used: {most} of {room}");
    // A view that needs more than there is room for keeps what it has.
    let mut selector = Selector::new(SelectSettings { max_texels: 100_000, ..SelectSettings::default() });
    let mut assets = [with_regions()];
    settle(&mut selector, &at(0.0, 0.0), &instances, &mut assets);
    let selection = selector.select(&at(0.0, 0.0), &instances, &assets);
    assert!(selection.counters.levels_without_room > 0 && selection.undo.is_empty());
}

#[test]
fn a_failed_tile_leaves_the_others() {
    let mut assets = [with_regions()];
    let tile = BlobPart::Tile(Tile { texture: 0, level: 2, tile: 1 });
    assets[0].set_state(tile, State::Failed);
    let view = above([0.0, 3.5, 0.1]);
    let selection = Selector::default().select(&view, &[Instance::at(0, [0.0; 3])], &assets).clone();
    assert_eq!(selection.failed, [BlobId::Asset { asset: 0, part: tile }]);
    assert_eq!(tiles(&selection.wanted).len(), 3);
    // Out of range: nothing is there.
    assert_eq!(assets[0].state(BlobPart::Tile(Tile { texture: 0, level: 2, tile: 4 })), State::Absent);
    let has = |level, tile| assets[0].has_image(BlobPart::Tile(Tile { texture: 0, level, tile }));
    assert!(has(2, 3) && !has(2, 4) && !has(1, 0) && !has(5, 0));
}
