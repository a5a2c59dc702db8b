//! Ground without visual faults: no black pits, no sharp borders of zones, no blue snow or marble in shade.

use glam::DVec3;
use half::f16;
use lodestream_scene::terrain::TerrainEntry;

use super::shapes::{asset, at, cube, quad};
use super::terrain::{draw, entry, ground_height, scene};
use super::{headless, keep};
use crate::cpu_reference::brdf::from_octahedral;
use crate::cpu_reference::depth::view_ray;
use crate::cpu_reference::tone::decode_srgb;
use crate::frame::graph::Resource;
use crate::{
    AntiAliasing, Drawable, Environment, Frame, Headless, Material, Placement, Pose, Settings, TileSource,
};

/// The names of the zones, from the lowest.
const ZONES: [&str; 4] = ["sand", "grass", "hill", "snow"];

/// Hills all in one zone, or steep enough for rock.
fn all_of(zone: usize) -> TerrainEntry {
    let mut entry = entry(3);
    entry.zones =
        [0, 1, 2].map(|border| if border < zone { -9e3 + border as f32 } else { 9e3 + border as f32 });
    entry
}

fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

fn radiance(h: &Headless) -> Vec<[f64; 3]> {
    let stored: Vec<f16> = bytemuck::pod_collect_to_vec(&h.intermediate(Resource::Radiance, 8).unwrap());
    stored.chunks(4).map(|texel| [0, 1, 2].map(|c| texel[c].to_f64())).collect()
}

/// Base colours, linear.
fn albedo(h: &Headless) -> Vec<[f64; 3]> {
    let stored = h.intermediate(Resource::Albedo, 4).unwrap();
    stored.chunks(4).map(|texel| [0, 1, 2].map(|c| decode_srgb(f64::from(texel[c]) / 255.0))).collect()
}

fn sharp() -> Settings {
    Settings { anti_aliasing: AntiAliasing::None, ..Settings::default() }
}

/// Relief and grass blades must not leave black pixels between them.
#[test]
fn there_are_no_black_pits_in_any_ground_from_any_height() {
    let Some(mut h) = headless(320, 180) else { return };
    let mut pits = Vec::new();
    for (zone, name) in ZONES.iter().enumerate() {
        let entry = all_of(zone);
        let mut ground = scene(&h, &entry);
        for over in [0.4, 1.7, 12.0, 150.0] {
            let eye = DVec3::new(40.0, ground_height(&entry, 40.0, 60.0) + over, 60.0);
            let camera = Pose::look_at(eye, eye + DVec3::new(1.0, -0.45, 0.6), DVec3::Y, 0.9);
            draw(&mut h, &mut ground, camera, 1.0, sharp());
            keep(&h, &format!("ground-{name}-{over}"));
            let seen = h.coverage().unwrap();
            let lit = h.intermediate(Resource::Sunlight, 2).unwrap();
            let light = radiance(&h);
            // Sunlit pixels, which are as bright as their neighbours apart from their own relief.
            let mut all: Vec<f64> = (0..light.len())
                .filter(|i| seen[*i] && lit[2 * i] == 255)
                .map(|i| luminance(light[i]))
                .collect();
            all.sort_by(f64::total_cmp);
            let at = |share: f64| all[((all.len() - 1) as f64 * share) as usize];
            let mean = all.iter().sum::<f64>() / all.len() as f64;
            // The sky alone gives a seventh to a third of the light that falls on level ground.
            let dark = all.iter().filter(|light| **light < 0.1 * mean).count();
            println!(
                "{name} from {over}: {} pixels, least {:.3} of the mean, a thousandth below {:.3}, {dark} below a tenth",
                all.len(),
                at(0.0) / mean,
                at(0.001) / mean
            );
            if all.len() < 10_000 || 2_000 * dark > all.len() {
                pits.push((name, over, dark, all.len()));
            }
        }
    }
    assert!(pits.is_empty(), "ground, eye's height, pixels below a tenth of the mean, of: {pits:?}");
}

/// A view straight down on gentle ground: heights, and linear base colours.
fn from_above(h: &mut Headless, entry: &TerrainEntry, [x, z]: [f64; 2], over: f64) -> Vec<(f64, [f64; 3])> {
    let mut ground = scene(h, entry);
    let eye = DVec3::new(x, ground_height(entry, x, z) + over, z);
    let camera = Pose::look_at(eye, eye - DVec3::Y, DVec3::Z, 1.0);
    let settings = Settings { relief: false, ..sharp() };
    draw(h, &mut ground, camera, 1.0, settings);
    let (width, height) = h.size();
    let tan: [f64; 2] = camera.tan_half_fov(width, height).into();
    let stored: Vec<f16> = bytemuck::pod_collect_to_vec(&h.intermediate(Resource::Normal, 8).unwrap());
    let all = h.depth().unwrap().into_iter().zip(albedo(h)).enumerate();
    all.filter_map(|(i, (depth, colour))| {
        let up = from_octahedral([stored[4 * i].to_f64(), stored[4 * i + 1].to_f64()])[1];
        let pixel = [(i as u32 % width).into(), (i as u32 / width).into()];
        let ray = camera.rotation * DVec3::from(view_ray(pixel, [width, height], tan));
        // Steep ground shows rock at all heights.
        (depth > 0.0 && up > 0.9).then(|| (eye.y + ray.y * settings.near / f64::from(depth), colour))
    })
    .collect()
}

#[test]
fn zones_have_no_knife_edges() {
    let Some(mut h) = headless(400, 400) else { return };
    let mut cut = Vec::new();
    // Borders of zones (sand to grass, grass to hill, hill to snow), each alone in a picture.
    for (border, name) in ["shore", "tree line", "snow line"].iter().enumerate() {
        let mut entry = entry(3);
        // Half of the ground in view lies below the border.
        let mut heights: Vec<f64> =
            from_above(&mut h, &entry, [0.0, 0.0], 600.0).into_iter().map(|(y, _)| y).collect();
        heights.sort_by(f64::total_cmp);
        let middle = heights[heights.len() / 2] as f32;
        entry.zones = [0, 1, 2].map(|i| middle + 50.0 * (i as f32 - border as f32));
        // The shader's value; borders above the shore are wider.
        let half_width = 0.08 * 50.0 * if border > 0 { 2.5 } else { 1.0 };
        let places = from_above(&mut h, &entry, [0.0, 0.0], 600.0);
        keep(&h, &format!("zones-{border}"));
        let mean_of = |from: f64, to: f64| {
            let within: Vec<_> =
                places.iter().filter(|(y, _)| (from..to).contains(y)).map(|(_, c)| *c).collect();
            let sum = within.iter().fold([0.0; 3], |sum, c| [0, 1, 2].map(|i| sum[i] + c[i]));
            (sum.map(|sum| sum / within.len() as f64), within.len())
        };
        let m = f64::from(middle);
        let ((below, some), (above, others)) =
            (mean_of(m - 25.0, m - 1.6 * half_width), mean_of(m + 1.6 * half_width, m + 25.0));
        assert!(some > 2000 && others > 2000, "{name}: {some} {others} pixels");
        let way = DVec3::from(above) - DVec3::from(below);
        // 0 for the colour below the border, 1 for the colour above it.
        let share = |c: [f64; 3]| (DVec3::from(c) - DVec3::from(below)).dot(way) / way.length_squared();
        let steps: Vec<f64> =
            (-20..20).map(|i| share(mean_of(m + f64::from(i), m + f64::from(i) + 1.0).0)).collect();
        let jump = steps.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        let wide = steps.iter().filter(|share| (0.1..0.9).contains(*share)).count();
        println!("{name}: {wide} m wide, at most {jump:.3} of it in a metre: {steps:.2?}");
        if !(jump < 0.25 && f64::from(wide as u32) >= half_width) {
            cut.push((name, jump, wide));
        }
    }
    assert!(cut.is_empty(), "border, largest step in a metre, metres: {cut:?}");
}

/// For bright, level surfaces in shade: the ratio of mean blue to mean red in their light, divided by that in their
/// base colours, and the number of pixels.
fn blue_in_shade(h: &Headless) -> (f64, usize) {
    let (seen, lit) = (h.coverage().unwrap(), h.intermediate(Resource::Sunlight, 2).unwrap());
    let stored: Vec<f16> = bytemuck::pod_collect_to_vec(&h.intermediate(Resource::Normal, 8).unwrap());
    let (mut sums, mut count) = ([0.0; 4], 0);
    for (i, (light, colour)) in radiance(h).iter().zip(albedo(h)).enumerate() {
        let up = from_octahedral([stored[4 * i].to_f64(), stored[4 * i + 1].to_f64()])[1];
        if seen[i] && lit[2 * i] == 0 && luminance(colour) > 0.5 && up > 0.8 {
            let more = [light[0], light[2], colour[0], colour[2]];
            sums = [0, 1, 2, 3].map(|k| sums[k] + more[k]);
            count += 1;
        }
    }
    (sums[1] / sums[0] / (sums[3] / sums[2]), count)
}

/// In shade they would otherwise be as blue as the sky that lights them.
#[test]
fn snow_and_marble_in_shade_are_white() {
    let Some(mut h) = headless(240, 135) else { return };
    let entry = all_of(3);
    let mut ground = scene(&h, &entry);
    let marble = Material { base_color: [0.86, 0.85, 0.83, 1.0], roughness: 0.4, ..Material::default() };
    let block = asset(&h, &cube(), marble.clone());
    let floor = asset(&h, &quad([-4.0, 0.0, 4.0], [8.0, 0.0, 0.0], [0.0, 0.0, -8.0], 1.0), marble);
    let drawables = [
        Drawable { asset: &block, instances: &[at(0.0, 0.5, 0.0, 1.0)] },
        Drawable { asset: &floor, instances: &[Placement::default()] },
    ];
    let mut blue = Vec::new();
    for degrees in [48.0_f64, 30.0, 12.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let environment =
            Environment { to_sun: DVec3::new(-0.3 * cos, sin, -0.95 * cos), ..Environment::default() };
        let view = Pose::look_at(DVec3::new(1.5, 1.6, 4.0), DVec3::new(0.2, 0.3, 0.4), DVec3::Y, 0.8);
        h.frame(&Frame { environment, settings: sharp(), ..Frame::new(view, &drawables) }).unwrap();
        keep(&h, &format!("marble-{degrees}"));
        let (marble, some) = blue_in_shade(&h);
        // A view towards the sun, over hills whose near sides are in shade.
        let eye = DVec3::new(-100.0, ground_height(&entry, -100.0, 400.0) + 60.0, 400.0);
        let camera = Pose::look_at(eye, eye + DVec3::new(-0.3, -0.3, -0.95), DVec3::Y, 0.9);
        ground.prepare(h.gpu(), &TileSource::Immediate, &camera, h.size(), 2.0).unwrap();
        let frame = Frame {
            terrain: Some(ground.frame()),
            environment,
            settings: sharp(),
            ..Frame::new(camera, &[])
        };
        h.frame(&frame).unwrap();
        keep(&h, &format!("snow-{degrees}"));
        let (snow, others) = blue_in_shade(&h);
        println!(
            "sun {degrees}°: blue over red in debug_view: marble {marble:.3} ({some} pixels), snow {snow:.3} ({others})"
        );
        // Unadapted it would be up to 1.9 on level ground. Snow that a high sun leaves in shade lies on slopes away from
        // it, which see the bluest half of the sky.
        let good = |share: f64| (0.9..1.6).contains(&share);
        if some < 300
            || !good(marble)
            || marble > 1.35
            || (degrees < 20.0 && others < 300)
            || (others >= 300 && !good(snow))
        {
            blue.push((degrees, marble, some, snow, others));
        }
    }
    assert!(blue.is_empty(), "sun's height, marble, pixels, snow, pixels: {blue:?}");
}
