//! Draws a scene from a Lodestream server in a wgpu program, among the program's own drawing, into a PNG file:
//! `cargo run --release -- ws://127.0.0.1:8080 picture.png`

use std::error::Error;
use std::time::Duration;

use lodestream_client::core::{Config, StartView};
use lodestream_client::net::Retry;
use lodestream_client::streaming::Streaming;
use lodestream_render::{Gpu, Load, Renderer, SceneView, Settings, Target};

const SIZE: [u32; 2] = [640, 360];
/// Screen error to refine to, in pixels.
const TARGET_PX: f32 = 1.0;
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [address, output] = &arguments[..] else { return Err("usage: embed ADDRESS OUTPUT.png".into()) };

    // What any wgpu program has: a device, a colour target and a depth target.
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&Default::default()))?;
    let (device, queue) = pollster::block_on(adapter.request_device(&Default::default()))?;
    let [colour, depth] = [FORMAT, wgpu::TextureFormat::Depth32Float].map(|format| {
        device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: SIZE[0], height: SIZE[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })
    });
    let [colour_view, depth_view] = [&colour, &depth].map(|texture| texture.create_view(&Default::default()));

    // Lodestream: a scene in this device's memory, fed by a streaming thread until nothing is missing.
    let gpu = Gpu::from_parts(adapter, device.clone(), queue.clone());
    let mut renderer = Renderer::new(&gpu, FORMAT)?;
    let mut scene = SceneView::new();
    let config = Config::new(StartView::OfScene { viewport_px: SIZE, target_px: TARGET_PX });
    let mut streaming = Streaming::start(address.parse()?, config, Retry::default(), || {})?;
    loop {
        // The status is read first: a status that says settled refers to steps taken after it.
        let status = streaming.status();
        while let Some(step) = streaming.take() {
            scene.push(step);
            scene.upload(&gpu, &renderer, usize::MAX, 0.0)?;
        }
        if let Some(end) = status.end {
            return Err(end.to_string().into());
        }
        if status.settled {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    let view = scene.header().ok_or("the server sent no scene")?.camera.view(SIZE, TARGET_PX);

    // A frame: first the program's own drawing, here an evening sky; then the scene, where it is nearer.
    let mut encoder = device.create_command_encoder(&Default::default());
    drop(encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &colour_view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color { r: 0.4, g: 0.15, b: 0.1, a: 1.0 }),
                store: wgpu::StoreOp::Store,
            },
        })],
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: &depth_view,
            // Depth is reversed: 0 is infinitely far.
            depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
            stencil_ops: None,
        }),
        ..Default::default()
    }));
    let size = (SIZE[0], SIZE[1]);
    let target = Target { colour: &colour_view, depth: Some(&depth_view), size, load: Load::Keep };
    scene.record(&gpu, &mut renderer, &mut encoder, &target, &view, Settings::default(), f32::MAX)?;

    // Copies the picture into a file. Rows of 640 pixels are 2560 bytes long, a multiple of the alignment for copies.
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(SIZE[0] * SIZE[1] * 4),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let layout = wgpu::TexelCopyBufferLayout { bytes_per_row: Some(SIZE[0] * 4), ..Default::default() };
    let copy = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(colour.as_image_copy(), copy, colour.size());
    queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |mapped| mapped.expect("a mapped buffer"));
    device.poll(wgpu::PollType::wait_indefinitely())?;
    let pixels = buffer.get_mapped_range(..)?;
    image::save_buffer(output, &pixels, SIZE[0], SIZE[1], image::ColorType::Rgba8)?;
    Ok(())
}
