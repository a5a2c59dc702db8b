//! Surface textures: ground near the eye and on banks, and textures at grazing angles.

use glam::DVec3;
use image::RgbaImage;

use super::shapes::{fill, quad};
use super::terrain::{draw, entry, ground_height, scene};
use super::{headless, keep};
use crate::cpu_reference::tone;
use crate::{
    AntiAliasing, DebugView, Drawable, Frame, Headless, Material, Placement, Pose, Settings, TextureData,
    TextureKind, TextureShape,
};
use lodestream_terrain::{Mode, Shape, Stamp};

/// Base colours only.
fn albedo() -> Settings {
    Settings { debug_view: DebugView::Albedo, anti_aliasing: AntiAliasing::None, ..Settings::default() }
}

fn green(picture: &RgbaImage, x: u32, y: u32) -> f64 {
    f64::from(picture.get_pixel(x, y)[1])
}

/// Mean difference of neighbours across and down, of 255.
fn contrasts(picture: &RgbaImage) -> [f64; 2] {
    let (width, height) = picture.dimensions();
    let pixels = (0..width - 1).flat_map(|x| (0..height - 1).map(move |y| (x, y)));
    let (mut sums, mut count) = ([0.0; 2], 0.0);
    for (x, y) in pixels {
        sums[0] += (green(picture, x, y) - green(picture, x + 1, y)).abs();
        sums[1] += (green(picture, x, y) - green(picture, x, y + 1)).abs();
        count += 1.0;
    }
    sums.map(|sum| sum / count)
}

#[test]
fn near_ground_has_detail_in_each_pixel() {
    let Some(mut h) = headless(160, 120) else { return };
    let entry = entry(3);
    let mut ground = scene(&h, &entry);
    // Grass: the second zone, flat.
    let height = |x: f64| ground_height(&entry, x, 0.0);
    let x = (0..400)
        .map(|i| f64::from(i) * 2.0)
        .find(|x| (-10.0..20.0).contains(&height(*x)) && (height(x + 2.0) - height(*x)).abs() < 0.3)
        .expect("some is flat");
    let feet = DVec3::new(x, height(x), 0.0);
    let eye = feet + DVec3::new(0.0, 0.2, 0.0);
    let camera = Pose::look_at(eye, feet + DVec3::new(0.1, 0.0, 0.07), DVec3::Y, 0.8);
    let picture = draw(&mut h, &mut ground, camera, 2.0, albedo());
    keep(&h, "ground-at-ones-feet");
    let [across, down] = contrasts(&picture);
    println!("{across} {down}");
    assert!(across > 4.0 && down > 4.0, "{across} {down}");
}

#[test]
fn banks_are_not_smeared() {
    let Some(mut h) = headless(160, 120) else { return };
    let mut entry = entry(3);
    entry.parameters.amplitude = 0;
    let ridge = Shape::Ridge { from: [-400, 0], to: [400, 0], half_width: 40, height: 20_000 };
    entry.stamps = vec![Stamp { mode: Mode::Additive, shape: ridge }];
    let mut ground = scene(&h, &entry);
    let half_way = (0..40).map(|z| f64::from(z) * 2.0).find(|z| ground_height(&entry, 0.0, *z) < 100.0);
    let z = half_way.expect("the ridge ends");
    let at = DVec3::new(0.0, ground_height(&entry, 0.0, z), z);
    let rise = ground_height(&entry, 0.0, z - 2.0) - ground_height(&entry, 0.0, z + 2.0);
    assert!(rise > 8.0, "the bank is steep: {rise} m over 4");
    let camera = Pose::look_at(at + DVec3::new(0.0, 0.5, 3.0), at, DVec3::Y, 0.6);
    let picture = draw(&mut h, &mut ground, camera, 2.0, albedo());
    keep(&h, "bank");
    let [across, down] = contrasts(&picture);
    println!("{across} {down}");
    assert!((0.6..1.7).contains(&(down / across)), "{across} {down}");
}

/// A floor of stripes that run away from the eye, two texels wide.
fn floor<R>(h: &mut Headless, draw: impl FnOnce(&mut Headless, &[Drawable<'_>]) -> R) -> R {
    const SIDE: u32 = 64;
    let material = Material { base_color_texture: Some(0), base_color: [1.0; 4], ..Material::default() };
    let shape = TextureShape::full(SIDE, SIDE, TextureKind::Color);
    let mut asset = h.renderer().create_asset(h.gpu(), DVec3::ZERO, &[material], &[shape]);
    fill(h, &mut asset, &quad([-8.0, 0.0, 0.0], [16.0, 0.0, 0.0], [0.0, 0.0, -16.0], 8.0));
    for level in 0..=SIDE.ilog2() {
        let side = 1 << level;
        let mean = |x: u32| {
            let run = (SIDE / side).max(1);
            let lit = (x * run..(x + 1) * run).filter(|x| x / 2 % 2 == 0).count() as f64;
            (tone::encode_srgb(0.05 + 0.75 * lit / f64::from(run)) * 255.0).round() as u8
        };
        let texels: Vec<u8> =
            (0..side * side).flat_map(|i| [[mean(i % side); 3].as_slice(), &[255]].concat()).collect();
        asset.update_texture(h.gpu(), 0, level, TextureData::Rgba8(&texels)).unwrap();
    }
    draw(h, &[Drawable { asset: &asset, instances: &[Placement::default()] }])
}

#[test]
fn textures_at_grazing_angles_stay_sharp_across() {
    const FINER: u32 = 6;
    let size = (96, 64);
    let (Some(mut h), Some(mut fine)) = (headless(size.0, size.1), headless(size.0 * FINER, size.1 * FINER))
    else {
        return;
    };
    // Only devices without an anisotropic filter, such as software drivers, take exactly the set number of lookups.
    if h.gpu().has_anisotropic_filter() {
        return;
    }
    let camera = Pose::look_at(DVec3::new(0.0, 0.35, 0.5), DVec3::new(0.0, 0.0, -2.5), DVec3::Y, 0.6);
    let shot = |h: &mut Headless, anisotropy: u32| {
        floor(h, |h, drawables| {
            let frame = Frame::new(camera, drawables);
            h.frame(&Frame { settings: Settings { anisotropy, ..albedo() }, ..frame }).unwrap();
            h.picture().unwrap()
        })
    };
    let truth = shot(&mut fine, 16);
    let light = |pixel: &image::Rgba<u8>| tone::decode_srgb(f64::from(pixel[1]) / 255.0);
    let off = [1, 2, 4, 8, 16].map(|anisotropy| {
        let picture = shot(&mut h, anisotropy);
        keep(&h, &format!("grazing-{anisotropy}"));
        let squares = picture.enumerate_pixels().map(|(x, y, pixel)| {
            let cells =
                (0..FINER * FINER).map(|i| truth.get_pixel(x * FINER + i % FINER, y * FINER + i / FINER));
            (light(pixel) - cells.map(light).sum::<f64>() / f64::from(FINER * FINER)).powi(2)
        });
        squares.sum::<f64>()
    });
    println!("squared error over that of one lookup: {:?}", off.map(|sum| sum / off[0]));
    assert!(off.is_sorted_by(|a, b| a >= b) && off[2] < 0.6 * off[0], "{off:?}");
}
