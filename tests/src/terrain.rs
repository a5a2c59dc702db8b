//! Streamed terrain: the client has the server's heights, and features arrive only where a view needs them.

use lodestream_bake::scene::{of_files, read};
use lodestream_client::core::Change;
use lodestream_daemon::SessionSettings;
use lodestream_demo_scene::{Options, generate};
use lodestream_terrain::tiles::{PlacedTerrain, TerrainView};
use lodestream_terrain::{Scratch, Terrain};

use crate::support::daemon::{Server, Transport};
use crate::support::picture::{draw, headless, keep};
use crate::support::scene::{TestScene, write_hills};
use crate::support::viewer::{Viewer, config};

/// Hills with a pit of height overrides at the corner of four patches, and a few overrides far away.
fn write_scene(folder: &std::path::Path, far: bool) -> std::path::PathBuf {
    let mut points = Vec::new();
    for y in -20..=20_i32 {
        for x in -20..=20_i32 {
            points.push(format!("[{x}, {y}, {}]", -2500 + 4 * (x * x + y * y)));
        }
    }
    if far {
        points.push("[2000, 2000, 5000]".to_owned());
    }
    let features = format!("{{\"mode\": \"fixed\", \"points\": [{}]}}", points.join(","));
    std::fs::write(folder.join("pit.json"), features).unwrap();
    let terrain = r#"features = "pit.json"
[[terrain.stamp]]
kind = "ridge"
from = [-200, -150]
to = [200, -190]
half_width = 60
height = 40
"#;
    write_hills(folder, terrain)
}

#[test]
fn height_overrides_arrive_where_the_view_needs_them_and_give_the_servers_heights() {
    let folder = tempfile::tempdir().unwrap();
    let scene = of_files(&[write_scene(folder.path(), true)]).unwrap();
    let theirs = scene.terrain.clone().unwrap();
    assert_eq!(theirs.entry.patches, 5, "four around the pit, one far away");
    let scene = TestScene::open(&scene, Vec::new());
    let server = Server::start(scene.source(), SessionSettings::default());
    for transport in Transport::BOTH {
        let mut viewer = Viewer::start(&server.address(transport), config());
        let status = viewer.settle();
        assert_eq!((status.stats.decode_failures, status.stats.refused), (0, 0), "{:?}", status.stats);
        let mut ours: Option<Terrain> = None;
        let mut patches = 0;
        for change in &viewer.changes {
            match change {
                Change::Scene(header) => {
                    let entry = header.terrain.as_ref().unwrap();
                    ours = Some(Terrain::with_stamps(entry.parameters, entry.stamps.clone()).unwrap());
                }
                Change::HeightOverrides { x, y, overrides: points } => {
                    patches += 1;
                    ours.as_mut().unwrap().set_points(*x, *y, points.clone()).unwrap();
                }
                _ => {}
            }
        }
        // A single override two kilometres away is below a pixel.
        assert_eq!(patches, 4, "{transport:?}");
        let ours = ours.unwrap();
        let (mut scratch, mut a, mut b) = (Scratch::new(), Vec::new(), Vec::new());
        for terrain in [(&ours, &mut a), (&theirs.terrain, &mut b)] {
            terrain.0.window(6, -128, -128, 257, 257, &mut scratch, terrain.1).unwrap();
        }
        assert!(a == b, "{transport:?}: heights differ");
        assert!(a.contains(&-2500));
    }
    server.assert_healthy();
}

#[test]
fn a_picture_of_streamed_terrain_shows_its_features() {
    let Some(mut headless) = headless() else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene = of_files(&[write_scene(folder.path(), false)]).unwrap();
    let scene = TestScene::open(&scene, Vec::new());
    let server = Server::start(scene.source(), SessionSettings::default());
    let mut viewer = Viewer::start(&server.address(Transport::Quic), config());
    viewer.settle();
    let whole = draw(&mut headless, viewer.changes.clone());
    keep(&whole, "terrain-pit");
    let points = |change: &Change| !matches!(change, Change::HeightOverrides { .. });
    let bare = draw(&mut headless, viewer.changes.into_iter().filter(points).collect());
    keep(&bare, "terrain-no-pit");
    let found = crate::support::picture::comparison(&whole, &bare);
    println!("{found:?}");
    assert!(found.covered > 0.5 && !crate::support::picture::same(&found), "{found:?}");
    server.assert_healthy();
}

/// Checks that terrain reaches the target error in the demo's start view, with at most a quarter of a million
/// triangles.
#[test]
fn the_demos_terrain_is_drawn_at_the_target_error() {
    let folder = tempfile::tempdir().unwrap();
    let scene = read(&generate(folder.path(), &Options::small(1)).unwrap().scene).unwrap();
    let (entry, camera) = (scene.terrain.unwrap().entry, scene.camera.unwrap());
    let terrain = Terrain::with_stamps(entry.parameters, entry.stamps.clone()).unwrap();
    let ground = PlacedTerrain::new(terrain.into(), entry.unit.into(), entry.height_unit.into());
    let pose = camera.view([1280, 720], 1.0).pose();
    let view = TerrainView::new(
        &ground,
        pose.eye,
        pose.rotation,
        pose.tan_half_fov(1280, 720),
        720,
        &mut Scratch::new(),
    );
    let tiles = ground.tiles(&view, 2.4, 4000);
    let triangles: u32 = tiles.selected.iter().map(|tile| 32 * tile.quadrants.count_ones()).sum();
    assert!(tiles.target_px == 2.4 && (100_000..=250_000).contains(&triangles), "{triangles}");
}
