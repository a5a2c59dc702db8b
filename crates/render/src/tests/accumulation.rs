//! Occlusion as a mean of frames: the result, its end, and what restarts it.

use glam::DVec3;
use half::f16;

use super::accuracy::blur_matches_its_cpu_reference;
use super::shapes::{Mesh, asset, at, cube, quad};
use super::{headless, keep};
use crate::cpu_reference::occlusion::{Blur, Normals, Occlusion};
use crate::cpu_reference::surface::DepthPicture;
use crate::frame::graph::Resource;
use crate::image_compare::compare;
use crate::{
    AmbientOcclusion, AntiAliasing, AssetGpu, DebugView, Drawable, Environment, Frame, Headless, Material,
    OcclusionMethod, OcclusionRadius, PackedVertex, PassId, Placement, Pose, STILL_FRAMES, Settings,
};

const SIZE: (u32, u32) = (96, 64);

fn settings(still: Option<OcclusionMethod>) -> Settings {
    let occlusion = AmbientOcclusion {
        radius: OcclusionRadius::World(0.4),
        strength: 1.0,
        still,
        ..AmbientOcclusion::default()
    };
    Settings {
        debug_view: DebugView::Occlusion,
        occlusion: Some(occlusion),
        anti_aliasing: AntiAliasing::None,
        shadows: None,
        ..Settings::default()
    }
}

fn camera() -> Pose {
    Pose::look_at(DVec3::new(0.8, 1.1, 2.0), DVec3::new(0.0, 0.2, 0.0), DVec3::Y, 0.8)
}

struct Scene {
    floor: AssetGpu,
    box_: AssetGpu,
}

impl Scene {
    fn new(h: &Headless) -> Self {
        let floor = quad([-3.0, 0.0, 3.0], [6.0, 0.0, 0.0], [0.0, 0.0, -6.0], 1.0);
        let of = |mesh: &Mesh| asset(h, mesh, Material::default());
        Self { floor: of(&floor), box_: of(&cube()) }
    }

    /// Draws a frame; returns the number of occlusion passes that ran.
    fn draw(&self, h: &mut Headless, x: f64, frame: impl FnOnce(&mut Frame<'_>)) -> usize {
        let (here, there) = ([Placement::default()], [at(x, 0.5, 0.0, 1.0)]);
        let drawables = [
            Drawable { asset: &self.floor, instances: &here },
            Drawable { asset: &self.box_, instances: &there },
        ];
        let mut with =
            Frame { settings: settings(Some(OcclusionMethod::Bitmask)), ..Frame::new(camera(), &drawables) };
        frame(&mut with);
        let counters = h.frame(&with).unwrap();
        let passes = counters.passes.iter();
        let count = passes.filter(|pass| [PassId::Occlusion, PassId::OcclusionBlur].contains(pass)).count();
        // A host that draws frames only after changes continues until the mean is complete.
        assert!(counters.is_unfinished() || count == 0 || counters.occlusion_frames_left == 0);
        count
    }
}

fn surfaces(stored: &[f32]) -> DepthPicture<'_> {
    DepthPicture {
        stored,
        size_px: [SIZE.0, SIZE.1],
        tan_half_fov: camera().tan_half_fov(SIZE.0, SIZE.1).into(),
        near: Settings::default().near,
    }
}

fn blur_of_a_mean_matches_its_cpu_reference(h: &Headless, number: u32) {
    let mean: Vec<f16> = bytemuck::pod_collect_to_vec(&h.intermediate(Resource::OcclusionMean, 2).unwrap());
    let raw: Vec<f64> = mean.iter().map(|value| value.to_f64()).collect();
    let stored = h.depth().unwrap();
    let radius = (f64::from(0.4_f32), 0.0);
    blur_matches_its_cpu_reference(h, &Blur { picture: surfaces(&stored), raw: &raw, radius, number });
}

#[test]
fn sixteen_frames_average_all_rotations_and_then_drawing_stops() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let scene = Scene::new(&h);
    // The first frame's estimate stands alone; the others are averaged.
    for frame in 0..=STILL_FRAMES {
        assert_eq!(scene.draw(&mut h, 0.0, |_| {}), 2, "frame {frame}");
        if [1, 6, STILL_FRAMES].contains(&frame) {
            blur_of_a_mean_matches_its_cpu_reference(&h, frame);
        }
    }
    let mean: Vec<f16> = bytemuck::pod_collect_to_vec(&h.intermediate(Resource::OcclusionMean, 2).unwrap());
    let stored = h.depth().unwrap();
    let picture = surfaces(&stored);
    let cpu_reference = |turned| Occlusion {
        picture,
        method: OcclusionMethod::Bitmask,
        normals: Normals::Nearest,
        radius: (f64::from(0.4_f32), 0.0),
        samples: 16,
        turned: Some(turned),
    };
    let mut off = 0;
    for (i, got) in mean.iter().enumerate() {
        let pixel = [(i % SIZE.0 as usize) as i64, (i / SIZE.0 as usize) as i64];
        let want = (0..16).map(|turned| cpu_reference(turned).openness(pixel, 1.0)).sum::<f64>() / 16.0;
        off += usize::from((got.to_f64() - want).abs() > 0.006);
    }
    assert!(off * 50 < mean.len(), "{off} of {} pixels are off the CPU reference's mean", mean.len());
    let last = h.picture().unwrap();
    keep(&h, "occlusion-accumulated");
    for _ in 0..3 {
        assert_eq!(scene.draw(&mut h, 0.0, |_| {}), 0);
        assert!(h.picture().unwrap() == last, "what is drawn without occlusion's passes has it all the same");
    }
    // Without the mean, the picture is that of a single estimate.
    scene.draw(&mut h, 0.0, |frame| frame.settings = settings(None));
    let alone = h.picture().unwrap();
    scene.draw(&mut h, 0.0, |_| {});
    assert!(h.picture().unwrap() == alone, "the first frame stands alone");
    assert!(compare(&alone, &last, None).unwrap().ssim > 0.8);
}

#[test]
fn only_visible_changes_restart_accumulation() {
    let (Some(mut h), Some(mut fresh)) = (headless(SIZE.0, SIZE.1), headless(SIZE.0, SIZE.1)) else { return };
    let mut scene = Scene::new(&h);
    let settle = |scene: &Scene, h: &mut Headless| {
        (0..=STILL_FRAMES).for_each(|_| {
            scene.draw(h, 0.0, |_| {});
        });
        assert_eq!(scene.draw(h, 0.0, |_| {}), 0, "it is settled");
    };
    type Change = (&'static str, f64, fn(&mut Frame<'_>));
    let changes: [Change; 5] = [
        ("an instance by a micrometre", 1e-6, |_| {}),
        ("the camera by a nanoradian", 0.0, |frame| {
            frame.camera.rotation = (frame.camera.rotation * glam::DQuat::from_rotation_y(1e-9)).normalize();
        }),
        ("samples", 0.0, |frame| {
            frame.settings.occlusion.as_mut().unwrap().samples = 8;
        }),
        ("light", 0.0, |frame| {
            frame.environment = Environment { to_sun: DVec3::new(0.1, 0.2, 0.3), ..frame.environment };
        }),
        ("the lens", 0.0, |frame| frame.camera.fov_y *= 1.0 + 1e-9),
    ];
    for (what, x, change) in changes {
        settle(&scene, &mut h);
        assert_eq!(scene.draw(&mut h, x, change), 2, "{what}");
        // After a change the picture contains nothing of earlier frames.
        let got = h.picture().unwrap();
        let other = Scene::new(&fresh);
        other.draw(&mut fresh, x, change);
        assert!(got == fresh.picture().unwrap(), "{what}");
    }
    // Time alone changes nothing, but moving vertices do until they have arrived.
    settle(&scene, &mut h);
    assert_eq!(scene.draw(&mut h, 0.0, |frame| frame.time_s = 5.0), 0);
    let mesh = quad([-3.0, 0.0, 3.0], [6.0, 0.0, 0.0], [0.0, 0.0, -6.0], 1.0);
    let moving: Vec<PackedVertex> = mesh.0.iter().map(|v| v.morphing([0.0; 3], 6.0)).collect();
    scene.floor.update_vertices(h.gpu(), 0, &moving).unwrap();
    for (time_s, passes) in [(6.1, 2), (6.1, 2), (6.2, 2), (7.0, 2)] {
        assert_eq!(scene.draw(&mut h, 0.0, |frame| frame.time_s = time_s), passes, "{time_s}");
    }
    for _ in 0..STILL_FRAMES {
        assert_eq!(scene.draw(&mut h, 0.0, |frame| frame.time_s = 8.0), 2);
    }
    assert_eq!(scene.draw(&mut h, 0.0, |frame| frame.time_s = 9.0), 0);
}
