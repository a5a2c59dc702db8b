//! Scenes of thousands of assets and parts: few calls, and the same picture as with a call for each draw.

use glam::{DQuat, DVec3};

use super::headless;
use super::shapes::{asset, at, cube, fill, join, quad, sphere};
use crate::{
    Alpha, AntiAliasing, AssetGpu, Counters, DebugView, Drawable, Frame, Gpu, Headless, InstanceStates,
    Material, PartState, PartStates, Placement, PnTriangles, Pose, Settings, Tint,
};

/// A renderer on a device that draws indirectly or does not.
fn device(h: &Headless, indirect: bool) -> Headless {
    let adapter = h.gpu().adapter.clone();
    let wanted = Gpu::WANTED_FEATURES & adapter.features();
    assert!(wanted.contains(wgpu::Features::INDIRECT_FIRST_INSTANCE), "software drivers have it");
    let without = if indirect { wgpu::Features::empty() } else { wgpu::Features::INDIRECT_FIRST_INSTANCE };
    let request = adapter.request_device(&wgpu::DeviceDescriptor {
        required_features: wanted - without,
        required_limits: adapter.limits(),
        ..Default::default()
    });
    let (device, queue) = pollster::block_on(request).unwrap();
    let gpu = Gpu::from_parts(adapter, device, queue);
    assert_eq!(gpu.draws_indirectly(), indirect);
    Headless::new(gpu, 200, 120).unwrap()
}

fn turned(x: f64, y: f64, z: f64, angle: f64) -> Placement {
    Placement::new(DVec3::new(x, y, z), DQuat::from_rotation_y(angle), 0.5)
}

/// Assets of every kind, and their placements.
fn scene(h: &Headless) -> Vec<(AssetGpu, Vec<Placement>)> {
    let material = |base_color, alpha| Material { base_color, alpha, ..Material::default() };
    let grey = material([0.6, 0.6, 0.6, 1.0], Alpha::Opaque);
    let floor = quad([-4.0, -0.3, 4.0], [8.0, 0.0, 0.0], [0.0, 0.0, -8.0], 1.0);
    let mut all = vec![(asset(h, &floor, grey.clone()), vec![Placement::default()])];
    for i in 0..12 {
        let mesh = if i % 2 == 0 { cube() } else { sphere(6 + i) };
        let glow = if i % 3 == 0 { [0.3, 0.1, 0.0] } else { [0.0; 3] };
        let own = Material { emission: glow, ..grey.clone() };
        let places =
            (0..3).map(|k| turned(f64::from(i) * 0.5 - 3.0, 0.1, f64::from(k) - 1.5, f64::from(i + k)));
        all.push((asset(h, &mesh, own), places.collect()));
    }
    // Too large for a page.
    all.push((asset(h, &sphere(100), grey.clone()), vec![at(0.0, 1.2, -1.0, 0.9)]));
    // Parts of several materials, some hidden or tinted.
    let materials = [
        grey,
        material([0.3, 0.5, 0.8, 0.6], Alpha::Blend),
        material([0.5, 0.8, 0.3, 0.7], Alpha::Mask(0.5)),
    ];
    let mut parts = h.renderer().create_asset(h.gpu(), DVec3::ZERO, &materials, &[]);
    let mut first = 0;
    for part in 0..6 {
        let (mut vertices, faces) = if part < 3 { cube() } else { sphere(8) };
        for vertex in &mut vertices {
            vertex.position[0] += part as f32 - 2.5;
            vertex.morph_from = vertex.position;
            *vertex = vertex.of_part(part);
        }
        parts.update_vertices(h.gpu(), first, &vertices).unwrap();
        let faces: Vec<_> = faces.iter().map(|face| face.map(|slot| slot + first as u32)).collect();
        let before = if part < 3 { 0 } else { 12 };
        parts.update_indices(h.gpu(), part as usize % 3, before, &faces).unwrap();
        first += vertices.len();
    }
    let tint = PartState { tint: Some(Tint { colour: [255, 0, 0], strength: 0.5 }), ..Default::default() };
    let states = InstanceStates { parts: [(0, PartState::HIDDEN), (2, tint)].into(), ..Default::default() };
    let instances = [(1, states)].into();
    parts.set_part_states(h.gpu(), PartStates { instances, ..Default::default() }).unwrap();
    all.push((parts, (0..3).map(|i| turned(0.2, 0.6 + 0.6 * f64::from(i), 0.3, 0.4)).collect()));
    let mut some = asset(h, &cube(), Material::default());
    some.set_drawn(Some([0, 3].into()));
    all.push((some, (0..5).map(|i| turned(f64::from(i) - 2.0, -0.1, 2.2, 0.0)).collect()));
    all
}

/// Pictures of frames in which things and camera move, and their counters.
fn pictures(h: &mut Headless, settings: Settings) -> Vec<(Vec<u8>, Counters)> {
    let mut scene = scene(h);
    let frames = (0..4).map(|number| {
        let shift = f64::from(number) * 0.05;
        for (_, places) in scene.iter_mut().skip(1).step_by(2) {
            places.iter_mut().for_each(|place| place.translation[1] += shift);
        }
        let drawables: Vec<_> =
            scene.iter().map(|(asset, instances)| Drawable { asset, instances }).collect();
        let camera = Pose::look_at(DVec3::new(shift, 2.1, 4.4), DVec3::new(0.0, 0.3, 0.0), DVec3::Y, 0.9);
        let counters = h.frame(&Frame { settings, ..Frame::new(camera, &drawables) }).unwrap();
        (h.picture().unwrap().into_raw(), counters)
    });
    frames.collect()
}

#[test]
fn indirect_calls_and_single_draws_give_the_same_pictures() {
    let Some(h) = headless(1, 1) else { return };
    let temporal = Settings { anti_aliasing: AntiAliasing::Temporal, ..Settings::default() };
    let all = [
        Settings::default(),
        temporal,
        Settings { wireframe: true, relief_in_depth: true, ..Settings::default() },
        Settings { debug_view: DebugView::Motion, ..temporal },
        Settings { debug_view: DebugView::Overdraw, ..Settings::default() },
        Settings { pn_triangles: Some(PnTriangles::default()), ..Settings::default() },
    ];
    for settings in all {
        let [calls, single] = [true, false].map(|indirect| pictures(&mut device(&h, indirect), settings));
        for ((picture, counters), (want, each)) in calls.iter().zip(&single) {
            assert!(picture == want, "{settings:?}");
            // All is drawn as patches, or something by indirect calls.
            let fewer = counters.calls < each.calls || settings.pn_triangles.is_some();
            assert!(fewer, "{} {} {settings:?}", counters.calls, each.calls);
            assert_eq!(&Counters { calls: each.calls, ..counters.clone() }, each);
        }
        assert!(calls.windows(2).all(|pair| pair[0].0 != pair[1].0), "things move: {settings:?}");
    }
}

/// Also: memory returns.
#[test]
fn thousands_of_assets_with_equal_materials_take_a_few_calls() {
    let Some(mut h) = headless(160, 90) else { return };
    let colours = [[0.8, 0.3, 0.2, 1.0], [0.2, 0.5, 0.8, 1.0]];
    let materials = colours.map(|base_color| Material { base_color, ..Material::default() });
    let assets: Vec<AssetGpu> = (0..5000).map(|i| asset(&h, &cube(), materials[i % 2].clone())).collect();
    let places: Vec<_> =
        (0..5000).map(|i| at(f64::from(i % 71) - 35.0, 0.0, f64::from(i / 71) - 35.0, 0.7)).collect();
    let drawables: Vec<_> =
        assets.iter().zip(places.chunks(1)).map(|(asset, instances)| Drawable { asset, instances }).collect();
    let camera = Pose::look_at(DVec3::new(0.0, 50.0, 60.0), DVec3::ZERO, DVec3::Y, 1.0);
    let counters = h.frame(&Frame::new(camera, &drawables)).unwrap();
    assert_eq!((counters.instances, counters.draws), (5000, 5000));
    let pools = h.renderer().mesh_pools().used();
    let passes = 1 + counters.shadow_maps;
    let pages = pools.iter().map(|pool| pool.pages as u32).sum::<u32>();
    // A page of faces may serve two of vertices and the reverse.
    assert!(counters.calls <= passes * 2 * pages && counters.calls < 150, "{counters:?} {pools:?}");
    assert_eq!(h.renderer().bound_materials(), 2);
    drop(assets);
    h.frame(&Frame::new(camera, &[])).unwrap();
    assert_eq!(h.renderer().mesh_pools().used().map(|pool| (pool.pages, pool.bytes)), [(0, 0); 2]);
    assert_eq!(h.renderer().bound_materials(), 0);
}

/// An asset is freed while the frame that shows it is recorded but not submitted; another takes its place.
#[test]
fn ranges_of_freed_assets_are_not_reused_before_the_next_frame() {
    let Some(mut h) = headless(64, 64) else { return };
    let camera = Pose::look_at(DVec3::new(0.0, 1.0, 2.0), DVec3::ZERO, DVec3::Y, 0.9);
    let picture = |h: &mut Headless, between: &dyn Fn(&Headless, AssetGpu)| {
        let shown = asset(h, &cube(), Material::default());
        let view = h.target_view();
        let mut encoder = h.gpu().device.create_command_encoder(&Default::default());
        let gpu = h.gpu().clone();
        let drawables = [Drawable { asset: &shown, instances: &[Placement::default()] }];
        let target = crate::Target::colour(&view, h.size());
        h.renderer_mut().record(&gpu, &mut encoder, &target, &Frame::new(camera, &drawables)).unwrap();
        between(h, shown);
        gpu.queue.submit([encoder.finish()]);
        h.picture().unwrap().into_raw()
    };
    let want = picture(&mut h, &|_, shown| drop(shown));
    let got = picture(&mut h, &|h, shown| {
        drop(shown);
        let mut other = asset(h, &join(&[sphere(5), cube()]), Material::default());
        fill(h, &mut other, &sphere(6));
        h.flush().unwrap();
    });
    assert!(got == want);
}
