//! Each switch of the settings omits the effect that it is named after, and nothing else: with it off, a frame equals,
//! to the bit, one of a scene without the cause of the effect.

use glam::DVec3;
use image::RgbaImage;

use super::shapes::{asset, at, quad, sphere};
use super::{headless, keep};
use crate::{
    Alpha, AntiAliasing, AssetGpu, DebugView, Drawable, Environment, Frame, Haze, Headless, LightCulling,
    Material, PassId, Placement, Pose, PunctualLight, Settings, Water,
};

const SIZE: (u32, u32) = (96, 64);
/// One near and one far.
const PUNCTUAL_LIGHTS: [PunctualLight; 2] = [
    PunctualLight { position: [1.4, 0.3, 0.6], intensity: [1.5; 3], range: 1.5, spot: None },
    PunctualLight { position: [-0.6, 0.6, -3.0], intensity: [1.5; 3], range: 1.5, spot: None },
];

/// A sloping shore with a glowing ball and a glowing pane of glass.
struct Scene {
    floor: AssetGpu,
    /// With emission, and without.
    balls: [AssetGpu; 2],
    panes: [AssetGpu; 2],
    here: [Placement; 1],
    there: [Placement; 1],
}

impl Scene {
    fn new(h: &Headless) -> Self {
        let floor = quad([-6.0, -0.6, 3.0], [12.0, 0.5, 0.0], [0.0, 0.2, -9.0], 1.0);
        let pane = quad([-1.8, -0.6, 1.0], [1.1, 0.0, 0.0], [0.0, 1.4, 0.0], 1.0);
        let glow = [[0.4, 0.1, 0.0], [0.0; 3]];
        let glass = Material { base_color: [0.7, 0.7, 0.7, 0.4], alpha: Alpha::Blend, ..Material::default() };
        let ball = Material { base_color: [0.1, 0.1, 0.1, 1.0], ..Material::default() };
        Self {
            floor: asset(h, &floor, Material { base_color: [0.4, 0.4, 0.4, 1.0], ..Material::default() }),
            balls: glow.map(|emission| asset(h, &sphere(24), Material { emission, ..ball.clone() })),
            panes: glow.map(|emission| asset(h, &pane, Material { emission, ..glass.clone() })),
            here: [Placement::default()],
            there: [at(0.2, 0.3, 0.0, 0.8)],
        }
    }

    /// Which objects the scene has: emissive ones, and glass.
    fn drawables(&self, glows: bool, glass: bool) -> Vec<Drawable<'_>> {
        let number = usize::from(!glows);
        let mut all = vec![
            Drawable { asset: &self.floor, instances: &self.here },
            Drawable { asset: &self.balls[number], instances: &self.there },
        ];
        if glass {
            all.push(Drawable { asset: &self.panes[number], instances: &self.here });
        }
        all
    }
}

/// All effects, without passes that have tests of their own.
fn frame<'a>(drawables: &'a [Drawable<'a>]) -> Frame<'a> {
    let camera = Pose::look_at(DVec3::new(0.3, 0.9, 3.4), DVec3::new(0.0, 0.1, 0.0), DVec3::Y, 0.8);
    Frame {
        lights: &PUNCTUAL_LIGHTS,
        water: Some(Water { level: -0.45, clarity: 2.0, ripples: 0.2 }),
        environment: Environment { haze: Some(Haze { visibility: 40.0 }), ..Environment::default() },
        settings: Settings {
            occlusion: None,
            shadows: None,
            anti_aliasing: AntiAliasing::None,
            ..Settings::default()
        },
        ..Frame::new(camera, drawables)
    }
}

/// Draws a frame: its picture, and its passes.
fn draw(h: &mut Headless, frame: &Frame<'_>) -> (RgbaImage, Vec<PassId>) {
    let passes = h.frame(frame).unwrap().passes;
    (h.picture().unwrap(), passes)
}

/// A switch: how it is set to off, the frame of the scene without the cause, its pass if it has one, and the least and
/// largest share of pixels that change with it.
type Switch<'a> = (&'a str, fn(&mut Settings), Frame<'a>, Option<PassId>, [f64; 2]);

#[test]
fn each_switch_affects_only_its_own_feature() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let scene = Scene::new(&h);
    let (all, dull, open) =
        (scene.drawables(true, true), scene.drawables(false, true), scene.drawables(true, false));
    let whole = frame(&all);
    let (on, with) = draw(&mut h, &whole);
    keep(&h, "switches");
    let clear = Environment { haze: None, ..whole.environment };
    let switches: [Switch<'_>; 5] = [
        (
            "punctual-lights",
            |settings| settings.lights = None,
            Frame { lights: &[], ..whole },
            Some(PassId::PunctualLights),
            [0.02, 0.6],
        ),
        ("haze", |settings| settings.haze = false, Frame { environment: clear, ..whole }, None, [0.3, 1.0]),
        ("emission", |settings| settings.emission = false, frame(&dull), Some(PassId::Emission), [0.05, 0.5]),
        (
            "transparency",
            |settings| settings.transparency = false,
            frame(&open),
            Some(PassId::Transparency),
            [0.05, 0.4],
        ),
        (
            "water",
            |settings| settings.water = false,
            Frame { water: None, ..whole },
            Some(PassId::Water),
            [0.05, 0.6],
        ),
    ];
    for (name, switch, without, pass, [least, most]) in switches {
        let mut off = whole;
        switch(&mut off.settings);
        let (picture, passes) = draw(&mut h, &off);
        keep(&h, &format!("switches-{name}"));
        let (lacking, _) = draw(&mut h, &without);
        assert!(picture == lacking, "{name}: not as where there is none");
        if let Some(pass) = pass {
            assert!(with.contains(&pass) && !passes.contains(&pass), "{name}: {with:?} {passes:?}");
        }
        let changed = picture.pixels().zip(on.pixels()).filter(|(a, b)| a != b).count();
        let share = changed as f64 / f64::from(SIZE.0 * SIZE.1);
        println!("{name}: {share}");
        assert!((least..=most).contains(&share), "{name} changes {share} of the picture");
        assert!(draw(&mut h, &whole).0 == on, "{name}: it leaves something behind");
    }
}

#[test]
fn dithering_is_at_most_a_step_of_the_display() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let scene = Scene::new(&h);
    let all = scene.drawables(true, true);
    let mut whole = frame(&all);
    let (on, _) = draw(&mut h, &whole);
    whole.settings.dither = false;
    let (off, _) = draw(&mut h, &whole);
    let steps: Vec<u8> = on.as_raw().iter().zip(off.as_raw()).map(|(a, b)| a.abs_diff(*b)).collect();
    let changed = steps.iter().filter(|step| **step > 0).count();
    assert!(
        steps.iter().all(|step| *step <= 1) && changed * 10 > steps.len(),
        "{changed} of {}",
        steps.len()
    );
}

/// Parameters of light culling change no picture, only the number of lights that are examined.
#[test]
fn tiles_and_clusters_change_time_of_punctual_lights_and_their_number_what_they_light() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let scene = Scene::new(&h);
    let all = scene.drawables(true, true);
    let mut with = |tile_px, clusters, most, shade| {
        let mut frame = frame(&all);
        frame.settings.debug_view = shade;
        frame.settings.lights = Some(LightCulling { tile_px, clusters, most });
        draw(&mut h, &frame).0
    };
    let usual = with(16, true, 9, DebugView::Material);
    for (tile_px, clusters) in [(8, true), (32, true), (64, true), (64, false)] {
        assert!(with(tile_px, clusters, 9, DebugView::Material) == usual, "{tile_px} {clusters}");
    }
    let looked = [(8, true), (64, true), (64, false)]
        .map(|(tile_px, clusters)| with(tile_px, clusters, 9, DebugView::PunctualLights));
    assert!(looked[0] != looked[1], "smaller tiles have fewer");
    assert!(looked[1] != looked[2], "and ranges of depth");
    assert!(with(16, true, 0, DebugView::Material) != usual);
}
