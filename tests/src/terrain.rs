//! Streamed terrain: the client has the server's heights, and features arrive only where a view needs them.

use std::fmt::Write as _;

use lodestream_bake::scene::{of_files, read};
use lodestream_client::core::Change;
use lodestream_daemon::SessionSettings;
use lodestream_demo_scene::{Options, generate};
use lodestream_scene::proxy::Cut;
use lodestream_server::catalogue::publish::publish;
use lodestream_store::Objects;
use lodestream_terrain::tiles::{PlacedTerrain, TerrainView};
use lodestream_terrain::{Scratch, Terrain};

use crate::support::daemon::{Server, Transport};
use crate::support::picture::{draw, headless, keep};
use crate::support::scene::{TestScene, options, write_hills};
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

/// Towers on a grid, whose base mesh keeps most of them.
fn towers(seed: u32) -> String {
    let mut text = String::new();
    for number in 0..196_u32 {
        let (x, z) = (f64::from(number % 14), f64::from(number / 14));
        let high = 1.0 + f64::from((number * 7 + seed * 11) % 23) / 8.0;
        for corner in 0..8_u32 {
            let along = |axis: u32| f64::from(corner >> axis & 1);
            let _ = writeln!(text, "v {} {} {}", x + 0.6 * along(0), high * along(1), z + 0.6 * along(2));
        }
        for face in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
            let [a, b, c, d] = face.map(|corner| 8 * number + corner + 1);
            let _ = writeln!(text, "f {a} {b} {c} {d}");
        }
    }
    text
}

#[test]
fn many_instances_on_terrain_begin_as_proxies() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = String::new();
    for number in 0..40_u32 {
        std::fs::write(folder.path().join(format!("{number}.obj")), towers(number)).unwrap();
        let (x, z) = (20.0 * f64::from(number % 6) - 50.0, 20.0 * f64::from(number / 6) - 50.0);
        let _ = write!(
            text,
            "[[asset]]\nname = \"{number}\"\nfile = \"{number}.obj\"\n[[instance]]\nasset = \"{number}\"\n\
             translation = [{x:.1}, 1.0, {z:.1}]\non_terrain = true\n"
        );
    }
    let scene = of_files(&[write_hills(folder.path(), &text)]).unwrap();
    let host = folder.path().join("host");
    std::fs::create_dir(&host).unwrap();
    let objects = Objects::of_folder(&host).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let cache = folder.path().join("cache");
    let done = runtime.block_on(publish(&scene, &objects, &cache, &options())).unwrap();
    let file = format!("file:{}/{}", host.display(), done.name).parse().unwrap();
    let mut viewer = Viewer::start(&file, config());
    let stats = viewer.settle().stats;
    assert_eq!((stats.decode_failures, stats.refused), (0, 0));
    let mut cuts = viewer.changes.iter().filter_map(|change| match change {
        Change::Cut(cut) => Some(cut),
        _ => None,
    });
    let first = cuts.next().expect("a cut through proxies");
    assert!(!first.proxies.is_empty(), "{first:?}");
    let last = cuts.next_back().expect("a finer cut");
    let covered = |cut: &Cut| cut.covered.iter().map(|[first, end]| end - first).sum::<u32>();
    assert!(covered(last) < covered(first), "the near ones are drawn themselves: {first:?} {last:?}");
    let header = viewer.changes.iter().find_map(|change| match change {
        Change::Scene(header) => Some(header),
        _ => None,
    });
    assert!(header.unwrap().terrain.is_some());
}
