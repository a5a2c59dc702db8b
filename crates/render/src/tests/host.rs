//! Drawing into a host's colour and depth targets, with its device.

use glam::{DVec3, Quat};
use image::RgbaImage;

use super::headless;
use super::shapes::{asset, at, cube, sphere};
use crate::resources::descriptors::texture_2d;
use crate::resources::readback::read_texture;
use crate::{
    AntiAliasing, Drawable, Frame, Gpu, Headless, Load, Material, Placement, Pose, RenderError, Renderer,
    Settings, Target,
};

const SIZE: (u32, u32) = (160, 90);
const COLOUR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// The colour to which the host cleared its target.
const HOST: [u8; 4] = [10, 20, 30, 255];

/// Two objects before the sky.
fn scene<R>(h: &mut Headless, draw: impl FnOnce(&mut Headless, &Frame<'_>) -> R) -> R {
    let box_ = asset(h, &cube(), Material::default());
    let ball = asset(h, &sphere(24), Material { base_color: [0.1, 0.3, 0.6, 1.0], ..Material::default() });
    let turned = Placement { rotation: Quat::from_rotation_y(0.6).into(), ..at(-0.6, 0.0, 0.0, 1.0) };
    let drawables = [
        Drawable { asset: &box_, instances: &[turned] },
        Drawable { asset: &ball, instances: &[at(0.7, 0.1, -0.4, 1.0)] },
    ];
    let camera = Pose::look_at(DVec3::new(0.2, 0.8, 2.6), DVec3::ZERO, DVec3::Y, 0.8);
    // Smoothing edges is left to the host.
    let settings = Settings { anti_aliasing: AntiAliasing::None, ..Settings::default() };
    draw(h, &Frame { settings, ..Frame::new(camera, &drawables) })
}

/// A host's colour and depth targets.
struct Host {
    colour: wgpu::Texture,
    depth: wgpu::Texture,
}

fn texture(gpu: &Gpu, format: wgpu::TextureFormat, size: (u32, u32), samples: u32) -> wgpu::Texture {
    let copied = if samples == 1 { wgpu::TextureUsages::COPY_SRC } else { wgpu::TextureUsages::empty() };
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | copied;
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        sample_count: samples,
        ..texture_2d("a host's", size, format, usage)
    })
}

impl Host {
    /// The colour [`HOST`] and a constant depth.
    fn new(gpu: &Gpu, depth: f32) -> Self {
        let host = Self { colour: texture(gpu, COLOUR, SIZE, 1), depth: texture(gpu, DEPTH, SIZE, 1) };
        let [r, g, b, a] = HOST.map(|x| f64::from(x) / 255.0);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        drop(encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &host.colour.create_view(&Default::default()),
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a }),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &host.depth.create_view(&Default::default()),
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(depth),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        }));
        gpu.queue.submit([encoder.finish()]);
        host
    }

    /// Draws a frame into the targets.
    fn record(&self, gpu: &Gpu, frame: &Frame<'_>, load: Load, with_depth: bool) {
        let mut renderer = Renderer::new(gpu, COLOUR).unwrap();
        let (colour, depth) =
            (self.colour.create_view(&Default::default()), self.depth.create_view(&Default::default()));
        let target = Target { colour: &colour, depth: with_depth.then_some(&depth), size: SIZE, load };
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        renderer.record(gpu, &mut encoder, &target, frame).unwrap();
        gpu.queue.submit([encoder.finish()]);
    }

    fn picture(&self, gpu: &Gpu) -> RgbaImage {
        RgbaImage::from_raw(SIZE.0, SIZE.1, read_texture(gpu, &self.colour, 4).unwrap()).unwrap()
    }

    fn depth(&self, gpu: &Gpu) -> Vec<f32> {
        bytemuck::pod_collect_to_vec(&read_texture(gpu, &self.depth, 4).unwrap())
    }
}

#[test]
fn a_cleared_host_gets_the_own_picture_and_its_depth_bit_for_bit() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    scene(&mut h, |h, frame| {
        h.frame(frame).unwrap();
        for with_depth in [false, true] {
            let host = Host::new(h.gpu(), 0.5);
            host.record(h.gpu(), frame, Load::Clear, with_depth);
            assert!(host.picture(h.gpu()) == h.picture().unwrap());
            let want = if with_depth { h.depth().unwrap() } else { vec![0.5; h.depth().unwrap().len()] };
            assert!(host.depth(h.gpu()) == want);
        }
        // With nothing in view: the sky, and a cleared depth.
        let empty = Frame { drawables: &[], ..*frame };
        h.frame(&empty).unwrap();
        let host = Host::new(h.gpu(), 0.5);
        host.record(h.gpu(), &empty, Load::Clear, true);
        assert!(host.picture(h.gpu()) == h.picture().unwrap());
        assert!(host.depth(h.gpu()).iter().all(|d| *d == 0.0));
    });
}

#[test]
fn a_hosts_picture_is_kept_where_it_is_nearer() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    scene(&mut h, |h, frame| {
        h.frame(frame).unwrap();
        let (own, own_depth) = (h.picture().unwrap(), h.depth().unwrap());
        // The host's wall cuts through the middle of the objects.
        let wall = (frame.settings.near / 2.6) as f32;
        for (host_depth, with_depth) in [(wall, true), (0.0, true), (wall, false)] {
            let host = Host::new(h.gpu(), host_depth);
            host.record(h.gpu(), frame, Load::Keep, with_depth);
            let (picture, depth) = (host.picture(h.gpu()), host.depth(h.gpu()));
            let (mut ours, mut hidden) = (0, 0);
            for (i, (got, own)) in picture.pixels().zip(own.pixels()).enumerate() {
                let limit = if with_depth { host_depth } else { 0.0 };
                let nearer = own_depth[i] > limit;
                ours += usize::from(nearer);
                hidden += usize::from(own_depth[i] > 0.0 && !nearer);
                assert_eq!(got.0, if nearer { own.0 } else { HOST }, "pixel {i}");
                let want = if nearer && with_depth { own_depth[i] } else { host_depth };
                assert_eq!(depth[i], want, "depth of pixel {i}");
            }
            assert!(ours > 500, "{ours}");
            assert_eq!(hidden > 500, with_depth && host_depth > 0.0, "{hidden}");
        }
        // Without objects nothing is drawn.
        let host = Host::new(h.gpu(), wall);
        host.record(h.gpu(), &Frame { drawables: &[], ..*frame }, Load::Keep, true);
        assert!(host.picture(h.gpu()).pixels().all(|pixel| pixel.0 == HOST));
        assert!(host.depth(h.gpu()).iter().all(|d| *d == wall));
    });
}

#[test]
fn a_hosts_device_with_default_limits_and_no_features_draws_the_same() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let want = scene(&mut h, |h, frame| {
        h.frame(frame).unwrap();
        h.picture().unwrap()
    });
    let adapter = h.gpu().adapter.clone();
    let (device, queue) = pollster::block_on(adapter.request_device(&Default::default())).unwrap();
    let gpu = Gpu::from_parts(adapter, device, queue);
    let mut host = Headless::new(gpu, SIZE.0, SIZE.1).unwrap();
    let got = scene(&mut host, |h, frame| {
        // Without the device feature, wireframes are left out and nothing fails.
        let settings = Settings { wireframe: true, ..frame.settings };
        h.frame(&Frame { settings, ..*frame }).unwrap();
        h.picture().unwrap()
    });
    assert!(got == want);
}

#[test]
fn invalid_target_views_are_errors() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    scene(&mut h, |h, frame| {
        let gpu = h.gpu();
        let mut renderer = Renderer::new(gpu, COLOUR).unwrap();
        let good = texture(gpu, COLOUR, SIZE, 1);
        let mut refused = |colour: &wgpu::Texture, depth: Option<&wgpu::Texture>, fragment: &str| {
            let view = colour.create_view(&Default::default());
            let depth = depth.map(|d| d.create_view(&Default::default()));
            let target = Target { depth: depth.as_ref(), load: Load::Keep, ..Target::colour(&view, SIZE) };
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            match renderer.record(gpu, &mut encoder, &target, frame) {
                Err(RenderError::Target(why)) => assert!(why.contains(fragment), "{why}"),
                other => panic!("{fragment}: {other:?}"),
            }
        };
        refused(&texture(gpu, wgpu::TextureFormat::Rgba16Float, SIZE, 1), None, "Rgba16Float");
        refused(&texture(gpu, COLOUR, SIZE, 4), None, "4 samples");
        refused(&texture(gpu, COLOUR, (8, 8), 1), None, "(8, 8) pixels");
        refused(&good, Some(&texture(gpu, COLOUR, SIZE, 1)), "not a depth format");
        refused(&good, Some(&texture(gpu, DEPTH, (8, 8), 1)), "(8, 8) pixels");
    });
}
