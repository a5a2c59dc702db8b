//! Closed walls stay closed: from inside the demo's temple, neither background nor sunlight is visible through its
//! walls.
//!
//! Its stones are separate components with bevelled edges, simplified independently. Gaps between them, or leaks in the
//! shadow maps, would be visible as lines of light or background.

use std::path::Path;

use glam::{DVec3, Vec3};
use lodestream_bake::scene::{Scene, read};
use lodestream_client::core::Change;
use lodestream_demo_scene::{Options, generate};
use lodestream_render::{AntiAliasing, GradientSky, Headless, Pose, SceneView, Settings, Sky};

use crate::support::picture::headless;
use crate::support::scene::{TestScene, prepare_all};

/// The small demo's temple alone, without ground; its floor is at a height of 1.08 m.
fn temple(folder: &Path) -> Scene {
    let summary = generate(folder, &Options::small(1)).unwrap();
    let mut scene = read(&summary.scene).unwrap();
    scene.terrain = None;
    let names: Vec<String> = scene.assets.iter().map(|asset| asset.name.clone()).collect();
    let parts = ["stylobate", "column", "entablature", "roof", "cella"];
    let kept =
        |asset: u32| (0..).zip(parts).find(|(_, part)| *part == names[asset as usize]).map(|(at, _)| at);
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

/// Surface data of a pixel.
struct Pixel {
    /// Direction, scaled to a depth of 1.
    through: DVec3,
    /// Depth; infinite for the sky.
    depth: f64,
    /// Whether it is sunlit.
    lit: bool,
}

/// Draws a view with and without the sun.
fn draw(h: &mut Headless, view: &SceneView, pose: Pose, shadows: bool) -> Vec<Pixel> {
    let mut settings = Settings { anti_aliasing: AntiAliasing::None, occlusion: None, ..Settings::default() };
    if !shadows {
        settings.shadows = None;
    }
    let [sun, none] = [true, false].map(|sun| {
        let drawn = view.with_frame(pose, settings, f32::MAX, |frame| {
            let mut frame = *frame;
            // Colours independent of the sun's light, so that they stay when it is off.
            let plain = GradientSky::default();
            let light = if sun { plain.sun } else { Vec3::ZERO };
            frame.environment.sky = Sky::Plain(GradientSky { sun: light, ..plain });
            h.frame(&frame)
        });
        drawn.unwrap();
        h.picture().unwrap()
    });
    let (width, height) = h.size();
    let (tx, ty) = pose.tan_half_fov(width, height);
    let pixels = (0_u32..).zip(h.depth().unwrap()).zip(sun.pixels().zip(none.pixels()));
    let pixels = pixels.map(|((i, depth), (sun, none))| {
        let ndc = |at: u32, side: u32| (2.0 * f64::from(at) + 1.0) / f64::from(side) - 1.0;
        let ray = DVec3::new(ndc(i % width, width) * tx, -ndc(i / width, height) * ty, -1.0);
        Pixel {
            through: pose.rotation * ray,
            depth: if depth > 0.0 { settings.near / f64::from(depth) } else { f64::INFINITY },
            lit: (0..3).any(|c| sun[c] > none[c].saturating_add(8)),
        }
    });
    pixels.collect()
}

fn pose([eye, target]: [[f64; 3]; 2]) -> Pose {
    Pose::look_at(eye.into(), target.into(), DVec3::Y, 0.85)
}

/// Numbers of faulty pixels of a view.
#[derive(Debug, PartialEq)]
struct FaultyPixels {
    /// Neither wall nor ceiling.
    open: usize,
    /// Beyond the wall.
    beyond: usize,
    /// Sunlit.
    lit: usize,
}

/// Counts faulty pixels of a view inside the brick walls, away from the door.
fn look(h: &mut Headless, view: &SceneView, place: [[f64; 3]; 2], shadows: bool) -> FaultyPixels {
    let pose = pose(place);
    let mut found = FaultyPixels { open: 0, beyond: 0, lit: 0 };
    for pixel in draw(h, view, pose, shadows) {
        found.lit += usize::from(pixel.lit);
        if pixel.depth.is_infinite() {
            found.open += 1;
            continue;
        }
        let seen = pose.eye + pixel.through * pixel.depth;
        // The walls' inner faces are at 3.1 and 8.1 m and reach 7.08 m up from the floor at 1.07 m; joints are a
        // centimetre deep.
        let out = (seen.x.abs() - 3.1).max(seen.z.abs() - 8.1);
        found.beyond += usize::from((1.0..7.0).contains(&seen.y) && out > 0.05);
    }
    found
}

/// A closed convex part of the temple: the places for which `normal · place ≤ reach` for all of its planes.
#[derive(Clone)]
struct Solid(Vec<(DVec3, f64)>);

impl Solid {
    fn cuboid(low: [f64; 3], high: [f64; 3]) -> Self {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let planes = (0..3).flat_map(|i| [(axes[i], high[i]), (-axes[i], -low[i])]);
        Self(planes.collect())
    }

    /// The part shrunk by a margin for joints, bevels and the mesh's error.
    fn core(&self, below: f64) -> Self {
        Self(self.0.iter().map(|(normal, reach)| (*normal, reach - below)).collect())
    }

    /// Where a ray enters it, in lengths of `ray`.
    fn entry(&self, eye: DVec3, ray: DVec3) -> Option<f64> {
        let (mut from, mut to) = (0.0_f64, f64::INFINITY);
        for (normal, reach) in &self.0 {
            let (left, along) = (reach - normal.dot(eye), normal.dot(ray));
            if along < 0.0 {
                from = from.max(left / along);
            } else if along > 0.0 {
                to = to.min(left / along);
            } else if left < 0.0 {
                return None;
            }
        }
        (from < to).then_some(from)
    }
}

/// The temple's closed pieces, as the demo scene's `temple.rs` builds them.
fn solids() -> Vec<Solid> {
    let cuboid = Solid::cuboid;
    let (floor, entablature, roof) = (1.08, 7.08, 8.83);
    // The brick walls, around a door 2.4 m wide and 4.3 m high.
    let mut all = vec![
        cuboid([-3.7, floor, -8.7], [3.7, entablature, -8.1]),
        cuboid([-3.7, floor, -8.7], [-3.1, entablature, 8.7]),
        cuboid([3.1, floor, -8.7], [3.7, entablature, 8.7]),
        cuboid([-3.7, floor, 8.1], [-1.2, entablature, 8.7]),
        cuboid([1.2, floor, 8.1], [3.7, entablature, 8.7]),
        cuboid([-1.2, floor + 4.3, 8.1], [1.2, entablature, 8.7]),
    ];
    // The entablature; its rings are at least as thick as its lowest, and meet at the mitres.
    for sign in [-1.0, 1.0_f64] {
        let [near, far] = [12.0 * sign - 0.5, 12.0 * sign + 0.5];
        all.push(cuboid([-6.5, entablature, near], [6.5, roof, far]));
        let [near, far] = [6.0 * sign - 0.5, 6.0 * sign + 0.5];
        all.push(cuboid([near, entablature, -12.5], [far, roof, 12.5]));
    }
    // Under the roof, a prism whose ends are the gables.
    let ridge = DVec3::new(0.0, roof + 2.34, 0.0);
    let slope = |x: f64, down: f64| DVec3::new(2.34 * x, down, 0.0).normalize();
    let ends = [(DVec3::NEG_Y, -roof), (DVec3::Z, 12.35), (DVec3::NEG_Z, 12.35)];
    let sides = [1.0, -1.0].map(|sign| slope(sign, 6.75)).map(|normal| (normal, normal.dot(ridge)));
    all.push(Solid(ends.into_iter().chain(sides).collect()));
    // On it, two slabs that carry the tiles.
    let ridge = DVec3::new(0.0, roof + 2.5, 0.0);
    for sign in [1.0, -1.0] {
        let (down, out) = (DVec3::new(7.25 * sign, -2.5, 0.0), DVec3::new(2.5 * sign, 7.25, 0.0));
        let (along, out) = (down.normalize(), out.normalize());
        let plane = |normal: DVec3, reach: f64| (normal, normal.dot(ridge) + reach);
        let slab = [plane(out, 0.0), plane(-out, 0.12), plane(along, down.length()), plane(-along, 0.0)];
        all.push(Solid(slab.into_iter().chain([(DVec3::Z, 13.15), (DVec3::NEG_Z, 13.15)]).collect()));
    }
    all
}

/// Faulty pixels of a view from outside: surfaces in or behind closed pieces, and sunlight through them; each with the
/// number of candidates.
#[derive(Debug, PartialEq)]
struct LeaksFromOutside {
    seen: usize,
    lit: usize,
    of: [usize; 2],
}

fn look_from_outside(h: &mut Headless, view: &SceneView, place: [[f64; 3]; 2]) -> LeaksFromOutside {
    let pose = pose(place);
    let to_sun = DVec3::from(view.header().unwrap().light.direction.map(f64::from)).normalize();
    // Slabs are 12 cm thick; bevels and joints are up to 5 cm deep at these angles. A shadow lookup reaches a texel or
    // two, which are wider the farther away.
    let cores = |below: f64| solids().iter().map(|solid| solid.core(below)).collect::<Vec<_>>();
    let (closed, dark) = (cores(0.055), cores(0.15));
    let mut found = LeaksFromOutside { seen: 0, lit: 0, of: [0, 0] };
    for pixel in draw(h, view, pose, true) {
        let entry = |eye, ray| move |solid: &Solid| solid.entry(eye, ray);
        let nearest = closed.iter().filter_map(entry(pose.eye, pixel.through)).reduce(f64::min);
        if let Some(nearest) = nearest {
            found.of[0] += 1;
            found.seen += usize::from(pixel.depth > nearest);
        }
        let seen = pose.eye + pixel.through * pixel.depth;
        if pixel.depth.is_finite() && dark.iter().any(|solid| solid.entry(seen, to_sun).is_some()) {
            found.of[1] += 1;
            found.lit += usize::from(pixel.lit);
        }
    }
    found
}

/// The temple, prepared.
fn prepared() -> TestScene {
    let folder = tempfile::tempdir().unwrap();
    let scene = temple(folder.path());
    let packs = prepare_all(&scene, &folder.path().join("cache"));
    TestScene::open(&scene, packs)
}

/// The temple refined to an error, optionally without one of its assets.
fn shown(h: &Headless, scene: &TestScene, error: f64, gone: Option<&str>) -> SceneView {
    let gone = gone.map(|name| scene.asset(name));
    let is_gone = |change: &Change| matches!(change, Change::Mesh(mesh) if Some(mesh.asset) == gone);
    let mut view = SceneView::new();
    view.push(scene.refined(error).into_iter().filter(|change| !is_gone(change)).collect());
    view.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
    view
}

#[test]
fn neither_light_nor_background_is_visible_through_closed_walls() {
    let Some(mut h) = headless() else { return };
    let scene = prepared();
    let views = [
        [[1.0, 3.0, 4.0], [0.0, 5.5, -8.7]],
        [[-2.0, 3.0, -1.0], [3.7, 5.0, -5.0]],
        [[2.0, 2.5, -6.0], [-3.0, 6.5, -7.0]],
    ];
    let clean = FaultyPixels { open: 0, beyond: 0, lit: 0 };
    // Fully refined, and refined as a view from 8 m away settles at 1 px.
    for error in [0.0, 0.02] {
        let view = shown(&h, &scene, error, None);
        for place in views {
            assert_eq!(look(&mut h, &view, place, true), clean, "error {error} from {place:?}");
        }
        // Without shadows, sunlight falls on every wall and on bevels that face the sun, so the measure detects it.
        let found = look(&mut h, &view, views[0], false);
        assert!(found.lit > 1000 && found.beyond == 0, "{found:?}");
    }
    // It also detects openings: without the roof, and without the walls.
    for (gone, what) in [("roof", 0), ("cella", 1)] {
        let view = shown(&h, &scene, 0.0, Some(gone));
        let found = look(&mut h, &view, views[0], true);
        assert!([found.open, found.beyond][what] > 1000, "without {gone}: {found:?}");
    }
}

#[test]
fn from_outside_nothing_is_visible_through_walls_roof_and_mitres() {
    let Some(mut h) = headless() else { return };
    let scene = prepared();
    // Each view is also drawn without the part that it looks at, to check that the opening is detected.
    let views = [
        ("cella", [[-15.0, 3.0, 4.0], [0.0, 4.0, 0.0]]),
        ("cella", [[15.0, 3.5, -6.0], [0.0, 4.0, -2.0]]),
        ("cella", [[3.0, 2.5, 21.0], [0.0, 4.5, 8.0]]),
        ("roof", [[-17.0, 17.0, 9.0], [0.0, 9.5, 1.0]]),
        ("roof", [[16.0, 15.0, -13.0], [0.0, 9.5, -3.0]]),
        ("roof", [[2.0, 10.0, 24.0], [0.0, 9.6, 13.0]]),
        // Mitres of three corners, from below and from inside.
        ("entablature", [[10.0, 6.3, 16.0], [6.5, 8.0, 12.5]]),
        ("entablature", [[-10.0, 6.0, -16.0], [-6.5, 8.0, -12.5]]),
        ("entablature", [[3.0, 4.0, -9.5], [6.2, 8.0, -12.2]]),
    ];
    for error in [0.0, 0.02] {
        let view = shown(&h, &scene, error, None);
        let mut dark = 0;
        for (what, place) in views {
            let found = look_from_outside(&mut h, &view, place);
            println!("{what} from {:?} at {error}: {found:?}", place[0]);
            assert!(found.of[0] > 5000, "{place:?}: {found:?}");
            assert_eq!((found.seen, found.lit), (0, 0), "error {error}: {what} from {place:?}");
            dark += found.of[1];
        }
        assert!(dark > 100_000, "{dark} pixels lie in the shadow of closed pieces");
    }
    for gone in ["cella", "roof", "entablature"] {
        let view = shown(&h, &scene, 0.0, Some(gone));
        for (_, place) in views.into_iter().filter(|(what, _)| *what == gone) {
            let found = look_from_outside(&mut h, &view, place);
            println!("without {gone} from {:?}: {found:?}", place[0]);
            assert!(found.seen > 1000, "without {gone} from {place:?}: {found:?}");
        }
        let place = [[3.0, 3.0, 3.0], [-1.0, 2.0, -4.0]];
        if gone == "roof" {
            // The sun reaches the floor beside the walls.
            let found = look_from_outside(&mut h, &view, place);
            assert!(found.lit > 1000, "without {gone}: {found:?}");
        }
    }
}
