//! Occlusion of one pixel of each 2×2: that it is what its CPU reference says, and that it is none where there should be none.

use glam::DVec3;
use image::RgbaImage;

use super::occlusion::{draw, shown, values};
use super::shapes::{asset, at, cube, flat_ground, quad, sphere};
use super::{headless, keep};
use crate::cpu_reference::occlusion::{Normals, Occlusion, Upsample, half_size};
use crate::cpu_reference::surface::DepthPicture;
use crate::frame::graph::Resource;
use crate::{
    AmbientOcclusion, AssetGpu, Drawable, Headless, Instance, Material, OcclusionMethod, OcclusionRadius,
    Pose, STILL_FRAMES, Settings,
};

fn halved(method: OcclusionMethod, radius: OcclusionRadius) -> Settings {
    let whole = shown(method, radius, 16);
    let half = |occlusion| AmbientOcclusion { half: true, ..occlusion };
    Settings { occlusion: whole.occlusion.map(half), ..whole }
}

/// A box on a block and a ball that lies in it.
struct Heap {
    box_: AssetGpu,
    ball: AssetGpu,
}

impl Heap {
    fn new(h: &Headless) -> Self {
        let of = |mesh| asset(h, mesh, Material::default());
        Self { box_: of(&cube()), ball: of(&sphere(24)) }
    }

    fn camera() -> Pose {
        Pose::look_at(DVec3::new(0.6, 1.3, 2.2), DVec3::new(0.0, 0.1, 0.0), DVec3::Y, 0.8)
    }

    fn draw(&self, h: &mut Headless, settings: Settings) -> RgbaImage {
        let drawables = [
            Drawable { asset: &self.box_, instances: &[at(0.0, -1.0, 0.0, 2.0), at(0.3, 0.25, 0.3, 0.5)] },
            Drawable { asset: &self.ball, instances: &[at(-0.4, 0.3, 0.2, 0.6)] },
        ];
        draw(h, Self::camera(), &drawables, settings)
    }
}

#[test]
fn half_resolution_occlusion_matches_its_cpu_references() {
    for size in [[160, 90], [97, 65], [5, 3], [1, 7], [1, 1]] {
        let Some(mut h) = headless(size[0], size[1]) else { return };
        let heap = Heap::new(&h);
        for method in OcclusionMethod::ALL.into_iter().filter(|way| *way != OcclusionMethod::HbaoPlus) {
            heap.draw(&mut h, halved(method, OcclusionRadius::World(0.3)));
            if size == [160, 90] {
                keep(&h, &format!("occlusion-half-{}", method.name()));
            }
            let stored = h.depth().unwrap();
            let picture = DepthPicture {
                stored: &stored,
                size_px: size,
                tan_half_fov: Heap::camera().tan_half_fov(size[0], size[1]).into(),
                near: Settings::default().near,
            };
            let radius = (f64::from(0.3_f32), 0.0);
            let cpu_reference =
                Occlusion { picture, method, normals: Normals::Nearest, radius, samples: 16, turned: None };
            let half: Vec<f64> =
                h.intermediate(Resource::OcclusionHalf, 1).unwrap().iter().map(share).collect();
            let place = |i: usize, width: u32| [i as i64 % i64::from(width), i as i64 / i64::from(width)];
            let [width, height] = half_size(size);
            assert_eq!(half.len(), (width * height) as usize);
            // Samples that land on a pixel's border or a threshold may go either way in f32.
            let off = half
                .iter()
                .enumerate()
                .filter(|(i, got)| (**got - cpu_reference.half_openness(place(*i, width), 1.0)).abs() > 0.01);
            let off = off.count();
            assert!(off * 50 <= half.len(), "{method:?} {size:?}: {off} of {} estimates differ", half.len());
            let upsample = Upsample { picture, half: &half, radius };
            let all = h.intermediate(Resource::Occlusion, 1).unwrap();
            let off = all
                .iter()
                .enumerate()
                .filter(|(i, got)| (share(got) - upsample.openness(place(*i, size[0]))).abs() > 0.51 / 255.0);
            let off = off.count();
            assert!(off * 1000 <= all.len(), "{method:?} {size:?}: {off} of {} pixels differ", all.len());
        }
    }
}

fn share(value: &u8) -> f64 {
    f64::from(*value) / 255.0
}

#[test]
fn hbao_plus_and_accumulated_frames_are_full_resolution() {
    let Some(mut h) = headless(97, 65) else { return };
    let (heap, radius) = (Heap::new(&h), OcclusionRadius::World(0.3));
    let layers = heap.draw(&mut h, shown(OcclusionMethod::HbaoPlus, radius, 16));
    assert!(heap.draw(&mut h, halved(OcclusionMethod::HbaoPlus, radius)) == layers);
    let mut mean = |settings: Settings| {
        let still = |occlusion| AmbientOcclusion { still: Some(OcclusionMethod::Gtao), ..occlusion };
        let settings = Settings { occlusion: settings.occlusion.map(still), ..settings };
        let frames: Vec<RgbaImage> = (0..=STILL_FRAMES).map(|_| heap.draw(&mut h, settings)).collect();
        [frames[0].clone(), frames[1].clone(), frames[STILL_FRAMES as usize].clone()]
    };
    let whole = mean(shown(OcclusionMethod::Gtao, radius, 16));
    let half = mean(halved(OcclusionMethod::Gtao, radius));
    assert!(whole[0] != half[0], "those that stand alone differ");
    assert!(whole[1..] == half[1..]);
}

#[test]
fn a_wall_far_behind_a_pillar_has_no_halo_at_half_the_pixels() {
    let Some(mut h) = headless(160, 90) else { return };
    let wall = quad([-40.0, -20.0, -20.0], [80.0, 0.0, 0.0], [0.0, 40.0, 0.0], 1.0);
    let parts = [wall, cube()].map(|mesh| asset(&h, &mesh, Material::default()));
    let here = [Instance::default()];
    let all = parts.each_ref().map(|asset| Drawable { asset, instances: &here });
    let camera = Pose::look_at(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, DVec3::Y, 0.6);
    for method in OcclusionMethod::ALL {
        let picture = draw(&mut h, camera, &all, halved(method, OcclusionRadius::World(1.0)));
        let darkest = picture.pixels().map(|pixel| pixel[0]).min().unwrap();
        // Neither the wall nor the pillar's face has anything before it.
        assert!(darkest >= 252, "{}: {darkest}", method.name());
    }
}

#[test]
fn flat_ground_is_open_up_to_the_horizon_at_half_the_pixels() {
    let Some(mut h) = headless(160, 90) else { return };
    let ground = flat_ground(&h);
    let all = [Drawable { asset: &ground, instances: &[Instance::default()] }];
    for height in [1.7, 0.05, 60.0] {
        let eye = DVec3::new(0.3, height, 0.0);
        let camera = Pose::look_at(eye, eye + DVec3::new(0.1, -0.05, -1.0), DVec3::Y, 0.9);
        for method in OcclusionMethod::ALL {
            for radius in [OcclusionRadius::Depth(0.06), OcclusionRadius::World(0.5)] {
                let picture = draw(&mut h, camera, &all, halved(method, radius));
                let covered = h.coverage().unwrap();
                let darkest = values(&picture, &covered).into_iter().min();
                assert!(darkest >= Some(254), "{} {height} {radius:?}: {darkest:?}", method.name());
            }
        }
    }
}
