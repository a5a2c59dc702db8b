//! Haze: distant things take the sky's colour, near ones keep their own, at all scales.

use glam::DVec3;
use image::RgbaImage;

use super::shapes::{asset, at, quad, sphere};
use super::{headless, keep};
use crate::image_compare::compare;
use crate::{Drawable, Environment, Frame, Haze, Material, Placement, Pose, Settings};

/// Colours along the middle column, from the top.
fn column(image: &RgbaImage) -> Vec<[i32; 3]> {
    let x = image.width() / 2;
    (0..image.height()).map(|y| [0, 1, 2].map(|c| i32::from(image.get_pixel(x, y)[c]))).collect()
}

#[test]
fn haze_hides_the_border_of_terrain() {
    let Some(mut h) = headless(64, 256) else { return };
    let dark = Material { base_color: [0.02, 0.02, 0.02, 1.0], ..Material::default() };
    let floor = asset(&h, &quad([-0.5, 0.0, 0.5], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], 1.0), dark);
    // Eighty kilometres of ground, seen from a tower: it ends half a degree, thirty lines, below the horizon.
    let ground = [at(0.0, 0.0, 0.0, 80e3)];
    let drawables = [Drawable { asset: &floor, instances: &ground }];
    let camera = Pose::look_at(DVec3::new(0.0, 400.0, 0.0), DVec3::new(0.0, 400.0, -1.0), DVec3::Y, 0.08);
    let mut steps = |haze| {
        let environment = Environment { haze, ..Environment::default() };
        let image = {
            h.frame(&Frame { environment, ..Frame::new(camera, &drawables) }).unwrap();
            keep(&h, if haze.is_some() { "haze" } else { "no-haze" });
            h.picture().unwrap()
        };
        let all = column(&image);
        let step = |pair: &[[i32; 3]]| (0..3).map(|c| (pair[0][c] - pair[1][c]).abs()).max();
        (all.windows(2).filter_map(step).max().unwrap(), all)
    };
    let (cut, _) = steps(None);
    let (gone, hazy) = steps(Some(Haze { visibility: 12e3 }));
    println!("largest step between lines: {cut} without haze, {gone} with");
    assert!(cut > 20 && gone <= 4, "{cut} {gone}");
    // The ground is still visible.
    let sum = |c: [i32; 3]| c.iter().sum::<i32>();
    assert!(sum(hazy[40]) > sum(hazy[255]) + 20, "{:?} {:?}", hazy[40], hazy[255]);
}

#[test]
fn haze_keeps_near_colours_at_any_scale() {
    let Some(mut h) = headless(96, 96) else { return };
    let ball = asset(&h, &sphere(24), Material::default());
    let mut shoot = |scale: f64, offset: DVec3, haze: Option<f64>| {
        let places = [
            Placement { scale: scale as f32, ..Placement::at(offset.into()) },
            Placement {
                scale: 8.0 * scale as f32,
                ..Placement::at((offset + DVec3::new(3.0, 2.0, -20.0) * scale).into())
            },
        ];
        let drawables = [Drawable { asset: &ball, instances: &places }];
        let camera = Pose::look_at(offset + DVec3::Z * 2.0 * scale, offset, DVec3::Y, 0.8);
        let settings = Settings { near: 1e-4 * scale, ..Settings::default() };
        let haze = haze.map(|visibility| Haze { visibility: visibility * scale });
        let environment = Environment { haze, ..Environment::default() };
        h.frame(&Frame { settings, environment, ..Frame::new(camera, &drawables) }).unwrap();
        h.picture().unwrap()
    };
    let clear = shoot(1.0, DVec3::ZERO, None);
    // A thousandth of the range takes 0.3 % of the contrast.
    let near = |image: &RgbaImage| {
        let [a, b] = [image, &clear].map(|image| image.get_pixel(48, 48).0);
        a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= 1)
    };
    assert!(near(&shoot(1.0, DVec3::ZERO, Some(2000.0))));
    let hazy = shoot(1.0, DVec3::ZERO, Some(40.0));
    assert!(!near(&hazy) && compare(&hazy, &clear, None).unwrap().mean_difference > 1.0);
    for (scale, offset) in [(1e-3, 0.0), (1e3, 0.0), (1.0, 6.371e6), (1e-3, 6.371e6), (1e6, 0.0)] {
        let found = compare(&shoot(scale, DVec3::splat(offset), Some(40.0)), &hazy, None).unwrap();
        println!("scale {scale} at {offset}: {found:?}");
        assert!(found.mean_difference < 0.1, "{scale} {offset}: {found:?}");
    }
}
