//! Time of the processor's part of a frame with thousands of assets and instances.

use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};

use super::headless;
use super::shapes::{asset, cube};
use crate::resources::descriptors::texture_2d;
use crate::{AntiAliasing, AssetGpu, Drawable, Frame, Headless, Material, Placement, Pose, Settings, Target};

const SIZE: (u32, u32) = (320, 180);

/// Places on a square grid in the plane, 2 units apart, turned differently.
fn places(count: u32) -> Vec<Placement> {
    let side = f64::from(count).sqrt().ceil() as u32;
    let at = |i: u32| f64::from(i) * 2.0 - f64::from(side);
    let place = |i: u32| {
        let (x, z) = (at(i % side), at(i / side));
        let turned = DQuat::from_rotation_y(f64::from(i % 17) * 0.3);
        Placement::new(DVec3::new(x, f64::from(i % 3) * 0.2, z), turned, 1.0)
    };
    (0..count).map(place).collect()
}

/// Medians of planning and recording a frame, and of finishing the commands, while the camera moves.
fn times(h: &mut Headless, drawables: &[Drawable<'_>], side: f64, settings: Settings) -> [Duration; 2] {
    let (format, usage) = (wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureUsages::RENDER_ATTACHMENT);
    let texture = h.gpu().device.create_texture(&texture_2d("picture", SIZE, format, usage));
    let view = texture.create_view(&Default::default());
    let gpu = h.gpu().clone();
    let mut all = Vec::new();
    for number in 0..24 {
        let shift = f64::from(number) * 0.003 * side;
        let eye = DVec3::new(shift, 1.9 * side, 2.3 * side);
        let camera = Pose::look_at(eye, DVec3::new(shift, 0.0, 0.0), DVec3::Y, 1.0);
        let frame = Frame { settings, ..Frame::new(camera, drawables) };
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let begin = Instant::now();
        let counters =
            h.renderer_mut().record(&gpu, &mut encoder, &Target::colour(&view, SIZE), &frame).unwrap();
        let recorded = begin.elapsed();
        let commands = encoder.finish();
        all.push([recorded, begin.elapsed() - recorded]);
        gpu.queue.submit([commands]);
        gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        assert_eq!(counters.instances_culled, 0, "all are in view");
    }
    let mut median = [Duration::ZERO; 2];
    for (i, median) in median.iter_mut().enumerate() {
        let mut times: Vec<_> = all[4..].iter().map(|times| times[i]).collect();
        times.sort();
        *median = times[times.len() / 2];
    }
    median
}

#[test]
#[ignore = "a measurement"]
fn time_of_many_assets_and_instances() {
    let Some(mut h) = headless(1, 1) else { return };
    let temporal = Settings { anti_aliasing: AntiAliasing::Temporal, ..Settings::default() };
    let plain = Settings { shadows: None, ..Settings::default() };
    for (assets, instances) in [(1, 1), (5_000, 1), (1, 100_000)] {
        let all = places(assets * instances);
        let side = f64::from(assets * instances).sqrt();
        let mut made: Vec<AssetGpu> = (0..assets).map(|_| asset(&h, &cube(), Material::default())).collect();
        made.iter_mut().for_each(|asset| asset.set_bounds(DVec3::ZERO, 0.9));
        let drawables: Vec<Drawable<'_>> = made
            .iter()
            .zip(all.chunks(instances as usize))
            .map(|(asset, instances)| Drawable { asset, instances })
            .collect();
        for (with, settings) in
            [("no shadows", plain), ("default", Settings::default()), ("temporal", temporal)]
        {
            let [recorded, finished] =
                times(&mut h, &drawables, side, settings).map(|time| time.as_secs_f64() * 1e3);
            println!(
                "{assets} assets of {instances}, {with}: plan and record {recorded:.2} ms, finish {finished:.2} ms"
            );
        }
    }
}
