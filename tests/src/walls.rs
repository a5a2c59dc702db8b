//! Closed walls stay closed: from inside the demo's temple nothing is seen, and no sunlight comes, through its walls.
//!
//! Its stones are components of their own, each with bevelled edges, and each is simplified for itself. What lay open
//! between them, or leaked past them in the maps of shadows, would show as dashes of light or of background.

use std::path::Path;

use glam::{DVec3, Vec3};
use lodestream_client::core::Change;
use lodestream_render::{AntiAliasing, Headless, PlainSky, Pose, SceneView, Settings, Sky};
use lodestream_server::demo_scene::{Options, generate};
use lodestream_server::scene::{Scene, read};

use crate::support::picture::headless;
use crate::support::scene::{TestScene, prepare_all};

/// The small demo's temple alone, without ground; its floor is 1.08 m up.
fn temple(folder: &Path) -> Scene {
    let summary = generate(folder, &Options::small(1)).unwrap();
    let mut scene = read(&summary.scene).unwrap();
    scene.terrain = None;
    let names: Vec<String> = scene.assets.iter().map(|asset| asset.name.clone()).collect();
    let parts = ["stylobate", "column", "entablature", "roof", "cella"];
    let kept = |asset: usize| parts.iter().position(|part| *part == names[asset]);
    let instances = scene.instances.take().unwrap();
    let placed = instances.into_iter().filter_map(|mut instance| {
        instance.asset = kept(instance.asset)?;
        Some(instance)
    });
    scene.instances = Some(placed.collect());
    let find = |part: &&str| scene.assets.iter().find(|asset| asset.name == *part).unwrap().clone();
    scene.assets = parts.iter().map(find).collect();
    scene
}

/// What a view shows that it should not, in pixels.
#[derive(Debug, PartialEq)]
struct Found {
    /// Neither wall nor ceiling.
    open: usize,
    /// Further away than the wall that stands there.
    beyond: usize,
    /// In sunlight.
    lit: usize,
}

/// Looks from inside the brick walls, away from the door.
fn look(h: &mut Headless, view: &SceneView, [eye, target]: [[f64; 3]; 2], shadows: bool) -> Found {
    let pose = Pose::look_at(eye.into(), target.into(), DVec3::Y, 0.85);
    let mut settings = Settings { anti_aliasing: AntiAliasing::None, occlusion: None, ..Settings::default() };
    if !shadows {
        settings.shadows = None;
    }
    let [sun, none] = [true, false].map(|sun| {
        let drawn = view.with_frame(pose, settings, f32::MAX, |frame| {
            let mut frame = *frame;
            // Colours that do not follow the sun, so that they stay when it goes.
            let plain = PlainSky::default();
            let light = if sun { plain.sun } else { Vec3::ZERO };
            frame.environment.sky = Sky::Plain(PlainSky { sun: light, ..plain });
            h.frame(&frame)
        });
        drawn.unwrap();
        h.picture().unwrap()
    });
    let brighter =
        |(a, b): &(&image::Rgba<u8>, &image::Rgba<u8>)| (0..3).any(|c| a[c] > b[c].saturating_add(8));
    let lit = sun.pixels().zip(none.pixels()).filter(brighter).count();
    let (width, height) = h.size();
    let (tx, ty) = pose.tan_half_fov(width, height);
    let (mut open, mut beyond) = (0, 0);
    for (i, depth) in (0_u32..).zip(h.depth().unwrap()) {
        if depth <= 0.0 {
            open += 1;
            continue;
        }
        let ndc = |at: u32, side: u32| (2.0 * f64::from(at) + 1.0) / f64::from(side) - 1.0;
        let ray = DVec3::new(ndc(i % width, width) * tx, -ndc(i / width, height) * ty, -1.0);
        let seen = pose.eye + pose.rotation * ray * (settings.near / f64::from(depth));
        // The walls' inner faces are at 3.1 and 8.1 m and reach 7.08 m up from the floor at 1.07 m; joints are a
        // centimetre deep.
        let out = (seen.x.abs() - 3.1).max(seen.z.abs() - 8.1);
        beyond += usize::from((1.0..7.0).contains(&seen.y) && out > 0.05);
    }
    Found { open, beyond, lit }
}

#[test]
fn no_light_and_no_background_is_seen_through_closed_walls() {
    let Some(mut h) = headless() else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene = temple(folder.path());
    let packs = prepare_all(&scene, &folder.path().join("cache"));
    let scene = TestScene::open(&scene, packs);
    let views = [
        [[1.0, 3.0, 4.0], [0.0, 5.5, -8.7]],
        [[-2.0, 3.0, -1.0], [3.7, 5.0, -5.0]],
        [[2.0, 2.5, -6.0], [-3.0, 6.5, -7.0]],
    ];
    let clean = Found { open: 0, beyond: 0, lit: 0 };
    // Whole, and as far refined as a view from 8 m away settles at 1 px.
    for error in [0.0, 0.02] {
        let mut view = SceneView::new();
        view.push(scene.refined(error));
        view.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
        for place in views {
            assert_eq!(look(&mut h, &view, place, true), clean, "error {error} from {place:?}");
        }
        // Without shadows the sun shines through every wall, and on bevels that face it: the measure sees it.
        let found = look(&mut h, &view, views[0], false);
        assert!(found.lit > 1000 && found.beyond == 0, "{found:?}");
    }
    // And it sees what is open: without the roof, and without the walls.
    for (gone, what) in [("roof", 0), ("cella", 1)] {
        let mut view = SceneView::new();
        let asset = scene.asset(gone);
        view.push(
            scene
                .refined(0.0)
                .into_iter()
                .filter(|change| !matches!(change, Change::Mesh(mesh) if mesh.asset == asset))
                .collect(),
        );
        view.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
        let found = look(&mut h, &view, views[0], true);
        assert!([found.open, found.beyond][what] > 1000, "without {gone}: {found:?}");
    }
}
