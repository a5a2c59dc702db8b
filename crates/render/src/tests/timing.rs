//! What passes took: of those that ran, and of no others.

use glam::DVec3;

use super::headless;
use super::shapes::{asset, at, cube, quad, sphere};
use crate::resources::descriptors::texture_2d;
use crate::{
    Alpha, AntiAliasing, Counters, DebugView, Drawable, Frame, Gpu, Headless, Material, PassId, Pose,
    RenderError, Settings, Target,
};

fn scene<R>(h: &mut Headless, draw: impl FnOnce(&mut Headless, &Frame<'_>) -> R) -> R {
    let box_ = asset(h, &cube(), Material::default());
    let ball = asset(h, &sphere(24), Material { emission: [0.2; 3], ..Material::default() });
    let pane = quad([-0.5, 0.0, 0.9], [1.0, 0.0, 0.0], [0.0, 0.5, 0.0], 1.0);
    let pane = asset(h, &pane, Material { opacity: 0.5, alpha: Alpha::Blend, ..Material::default() });
    let drawables = [
        Drawable { asset: &box_, instances: &[at(0.0, -1.0, 0.0, 2.0)] },
        Drawable { asset: &ball, instances: &[at(-0.2, 0.3, 0.2, 0.6)] },
        Drawable { asset: &pane, instances: &[at(0.0, 0.0, 0.0, 1.0)] },
    ];
    let camera = Pose::look_at(DVec3::new(0.6, 1.3, 2.2), DVec3::ZERO, DVec3::Y, 0.8);
    draw(h, &Frame::new(camera, &drawables))
}

fn timed(h: &mut Headless) -> Vec<PassId> {
    h.timings().passes.iter().map(|time| time.pass).collect()
}

#[test]
fn times_are_of_the_passes_that_ran() {
    let Some(mut h) = headless(160, 90) else { return };
    let stamps = h.gpu().device.features().contains(wgpu::Features::TIMESTAMP_QUERY);
    scene(&mut h, |h, frame| {
        h.frame(frame).unwrap();
        assert_eq!(h.timings(), Default::default(), "nobody asked");
        h.time_passes(true);
        let plain = Settings { shadows: None, anti_aliasing: AntiAliasing::None, ..frame.settings };
        let normals = Settings { debug_view: DebugView::Normal, ..frame.settings };
        // A pass of each kind there is, with as many shadow maps as there may be.
        let edges = Settings { wireframe: true, ..frame.settings };
        for settings in [frame.settings, plain, normals, edges] {
            let mut ran = Vec::new();
            for _ in 0..3 {
                ran = h.frame(&Frame { settings, ..*frame }).unwrap().passes;
            }
            assert_eq!(timed(h), ran);
            let lit = ran.contains(&PassId::Lighting);
            assert!([PassId::Emission, PassId::Transparency].iter().all(|pass| ran.contains(pass) == lit));
            let timings = h.timings();
            assert!(timings.plan > std::time::Duration::ZERO);
            assert!(timings.passes.iter().all(|time| time.gpu.is_some() == stamps), "{timings:?}");
            let sum: std::time::Duration = timings.passes.iter().filter_map(|time| time.gpu).sum();
            assert!(!stamps || sum > std::time::Duration::ZERO, "{timings:?}");
        }
        assert_eq!(h.timings().frames, 12);
        for _ in 0..40 {
            h.frame(frame).unwrap();
        }
        assert_eq!(h.timings().frames, 30, "as many as are kept");
        h.time_passes(false);
        h.frame(frame).unwrap();
        assert_eq!(timed(h), []);
    });
}

/// Records a frame and submits it, or not.
fn record(h: &mut Headless, frame: &Frame<'_>, submit: bool) -> Result<Counters, RenderError> {
    let (format, usage) = (wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureUsages::RENDER_ATTACHMENT);
    let texture = h.gpu().device.create_texture(&texture_2d("picture", (16, 16), format, usage));
    let view = texture.create_view(&Default::default());
    let gpu = h.gpu().clone();
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let target = Target::colour(&view, (16, 16));
    let counters = h.renderer_mut().record(&gpu, &mut encoder, &target, frame)?;
    if submit {
        gpu.queue.submit([encoder.finish()]);
    }
    Ok(counters)
}

/// A host may drop a frame, and need not wait for one before it records the next.
#[test]
fn dropped_frames_release_their_timestamps() {
    let Some(mut h) = headless(160, 90) else { return };
    if !h.gpu().device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
        return;
    }
    scene(&mut h, |h, frame| {
        h.time_passes(true);
        for _ in 0..10 {
            record(h, frame, false).unwrap();
        }
        for _ in 0..10 {
            record(h, frame, true).unwrap();
        }
        h.gpu().device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        h.frame(frame).unwrap();
        let timings = h.timings();
        assert!(timings.passes.iter().all(|time| time.gpu.is_some()), "{timings:?}");
        h.gpu().check().unwrap();
    });
}

#[test]
fn a_hosts_device_without_timestamps_gives_times_of_recording_alone() {
    let Some(h) = headless(1, 1) else { return };
    let adapter = h.gpu().adapter.clone();
    let (device, queue) = pollster::block_on(adapter.request_device(&Default::default())).unwrap();
    let mut h = Headless::new(Gpu::from_parts(adapter, device, queue), 64, 36).unwrap();
    scene(&mut h, |h, frame| {
        h.time_passes(true);
        let ran = h.frame(frame).unwrap().passes;
        h.frame(frame).unwrap();
        assert_eq!(timed(h), ran);
        assert!(h.timings().passes.iter().all(|time| time.gpu.is_none()));
    });
}
