//! Terrain: ground without cracks, and levels of detail whose differences agree with their stated errors.

use glam::{DVec2, DVec3};
use image::RgbaImage;
use lodestream_geometry::random::Random;
use lodestream_scene::terrain::TerrainEntry;
use lodestream_terrain::{Mode, Parameters, Scratch, Shape, Stamp, Terrain};
use wgpu::util::DeviceExt;

use super::{headless, keep};
use crate::cpu_reference::depth::view_ray;
use crate::cpu_reference::terrain::{Tile, zone_weights};
use crate::frame::draw::{DrawList, ListMemory};
use crate::frame::graph::Resource;
use crate::frame::placed::PlacedInstances;
use crate::image_compare::compare;
use crate::passes::shadows;
use crate::resources::descriptors::wgsl;
use crate::scene::tile_generator::TileGenerator;
use crate::{
    Counters, DebugView, Environment, Frame, Gpu, Headless, Pose, Settings, Shadows, TerrainRenderer,
    TileSource,
};
use lodestream_terrain::tiles::{PlacedTerrain, TILE_CELLS, TileId, TileRegion};

/// Hills of some hundred metres on patches of 512 m, heights in centimetres.
pub(super) fn entry(seed: u64) -> TerrainEntry {
    TerrainEntry {
        parameters: Parameters {
            seed,
            finest_level: 8,
            extent_log2: 5,
            amplitude: 9_000,
            ..Parameters::default()
        },
        unit: 2.0,
        height_unit: 0.01,
        zones: [-40.0, 45.0, 110.0],
        stamps: Vec::new(),
        patches: 0,
        water: None,
    }
}

/// The same with a sharp crest, a crater and a river bed, rougher than the rest, in the middle.
fn rough_entry(seed: u64) -> TerrainEntry {
    let ridge = Shape::Ridge { from: [-900, -700], to: [700, 400], half_width: 260, height: 14_000 };
    let crater = Shape::Crater { centre: [300, -500], radius: 120, depth: 3_000, rim: 2_000 };
    let line = vec![[-800, 300], [-300, 500], [100, 350], [900, 800]];
    let river = Shape::RiverBed { line, half_width: 16, depth: 900 };
    let stamps = [ridge, crater, river].map(|shape| Stamp { mode: Mode::Additive, shape });
    TerrainEntry { stamps: stamps.to_vec(), ..entry(seed) }
}

/// A smooth world for an even seed, else a rough one.
fn alternating_entry(seed: u64) -> TerrainEntry {
    if seed.is_multiple_of(2) { entry(seed) } else { rough_entry(seed) }
}

fn terrain(entry: &TerrainEntry) -> Terrain {
    Terrain::with_stamps(entry.parameters, entry.stamps.clone()).unwrap()
}

pub(super) fn scene(h: &Headless, entry: &TerrainEntry) -> TerrainRenderer {
    TerrainRenderer::new(h.gpu(), h.renderer(), entry, None).unwrap()
}

pub(super) fn draw(
    h: &mut Headless,
    ground: &mut TerrainRenderer,
    camera: Pose,
    px: f64,
    settings: Settings,
) -> RgbaImage {
    let gpu_size = h.size();
    ground.prepare(h.gpu(), &TileSource::Immediate, &camera, gpu_size, px).unwrap();
    let frame = Frame { terrain: Some(ground.frame()), settings, ..Frame::new(camera, &[]) };
    h.frame(&frame).unwrap();
    h.picture().unwrap()
}

/// Prepares shadow casters out of view, for a view whose ground is prepared.
pub(super) fn prepare_casters(
    h: &Headless,
    ground: &mut TerrainRenderer,
    making: &TileSource,
    camera: Pose,
    to_sun: DVec3,
) {
    let environment = Environment { to_sun, ..Environment::default() };
    let frame = Frame { terrain: Some(ground.frame()), environment, ..Frame::new(camera, &[]) };
    let mut placed = PlacedInstances::default();
    placed.update(frame.drawables);
    let list = DrawList::new(&frame, h.size(), &placed, ListMemory::default(), &mut Counters::default());
    let cascades = shadows::of_frame(&frame, &list, Shadows::default());
    ground.prepare_casters(h.gpu(), making, &cascades).unwrap();
}

/// The same with shadows, with or without casters out of view.
fn draw_in_the_sun(
    h: &mut Headless,
    ground: &mut TerrainRenderer,
    (camera, to_sun): (Pose, DVec3),
    out_of_view: bool,
) -> Vec<u8> {
    let size = h.size();
    ground.prepare(h.gpu(), &TileSource::Immediate, &camera, size, 2.0).unwrap();
    if out_of_view {
        prepare_casters(h, ground, &TileSource::Immediate, camera, to_sun);
    }
    let environment = Environment { to_sun, ..Environment::default() };
    h.frame(&Frame { terrain: Some(ground.frame()), environment, ..Frame::new(camera, &[]) }).unwrap();
    h.intermediate(Resource::Sunlight, 2).unwrap().chunks(2).map(|lit| lit[0]).collect()
}

/// Whether places on the ground see the sun, by steps along rays over its finest level.
struct Rays {
    terrain: Terrain,
    entry: TerrainEntry,
    /// Heights of points from `first` on, in rows of `side`.
    heights: Vec<i32>,
    first: i64,
    side: usize,
}

impl Rays {
    fn new(entry: &TerrainEntry, reach: f64) -> Self {
        let terrain = terrain(entry);
        let first = -(reach / f64::from(entry.unit)) as i64;
        let side = (2 * -first + 1) as usize;
        let mut heights = Vec::new();
        let level = terrain.finest_level();
        terrain.window(level, first, first, side, side, &mut Scratch::new(), &mut heights).unwrap();
        Self { terrain, entry: entry.clone(), heights, first, side }
    }

    /// Height of the ground, bilinear between points; `None` outside the stored points.
    fn height(&self, x: f64, z: f64) -> Option<f64> {
        let [x, z] = [x, z].map(|v| v / f64::from(self.entry.unit) - self.first as f64);
        let (i, j) = (x.floor(), z.floor());
        let inside = i >= 0.0 && j >= 0.0 && i + 1.0 < self.side as f64 && j + 1.0 < self.side as f64;
        let at = |a: f64, b: f64| f64::from(self.heights[(j + b) as usize * self.side + (i + a) as usize]);
        let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
        inside.then(|| {
            let height =
                mix(mix(at(0.0, 0.0), at(1.0, 0.0), x - i), mix(at(0.0, 1.0), at(1.0, 1.0), x - i), z - j);
            height * f64::from(self.entry.height_unit)
        })
    }

    /// The least height of a ray to the sun above the ground, relative to the distance travelled: below 0 the place is
    /// in shade.
    fn clearance(&self, at: DVec3, to_sun: DVec3) -> f64 {
        let sun = to_sun.normalize();
        let mut least = f64::INFINITY;
        let highest = self.terrain.parameters().worst_height() as f64 * f64::from(self.entry.height_unit);
        let mut along = 2.0;
        while let Some(place) = Some(at + sun * along).filter(|place| place.y <= highest) {
            let Some(height) = self.height(place.x, place.z) else { break };
            least = least.min((place.y - height) / along);
            along += 2.0;
        }
        least
    }
}

#[test]
fn missing_shadow_casters_count_as_missing_tiles() {
    let Some(h) = headless(160, 90) else { return };
    let entry = rough_entry(3);
    let eye = DVec3::new(-100.0, ground_height(&entry, -100.0, 400.0) + 30.0, 400.0);
    let camera = Pose::look_at(eye, eye + DVec3::new(0.1, -0.2, 1.0), DVec3::Y, 0.9);
    let to_sun = DVec3::new(0.3, 0.11, -0.95);
    let prepare = |ground: &mut TerrainRenderer, making: &TileSource| {
        ground.prepare(h.gpu(), making, &camera, h.size(), 2.0).unwrap();
        prepare_casters(&h, ground, making, camera, to_sun);
        (ground.missing(), ground.frame().parts.len(), ground.frame().casters.len())
    };
    let (_, parts, casters) = prepare(&mut scene(&h, &entry), &TileSource::Immediate);
    assert!(casters > 10, "{casters}");
    let mut ground = scene(&h, &entry);
    let apart = TileSource::Thread(TileGenerator::start(|| {}).unwrap());
    // Without a time limit, since the thread may take any time.
    let made = loop {
        let (missing, parts, casters) = prepare(&mut ground, &apart);
        if missing == 0 {
            break (parts, casters);
        }
        std::thread::yield_now();
    };
    assert_eq!(made, (parts, casters), "tiles made by a thread equal those made at once");
}

#[test]
fn hills_cast_shadows_on_hills_even_from_out_of_view() {
    let Some(mut h) = headless(160, 90) else { return };
    let entry = rough_entry(3);
    let mut ground = scene(&h, &entry);
    let rays = Rays::new(&entry, 3000.0);
    // Before the crest, the sun low behind it and behind the eye.
    let eye = DVec3::new(-100.0, ground_height(&entry, -100.0, 400.0) + 30.0, 400.0);
    let camera = Pose::look_at(eye, eye + DVec3::new(0.1, -0.2, 1.0), DVec3::Y, 0.9);
    let to_sun = DVec3::new(0.3, 0.11, -0.95);
    let seen = draw_in_the_sun(&mut h, &mut ground, (camera, to_sun), false);
    let all = draw_in_the_sun(&mut h, &mut ground, (camera, to_sun), true);
    keep(&h, "terrain-shadows");
    let depth = h.depth().unwrap();
    let (width, height) = h.size();
    let (tx, ty) = camera.tan_half_fov(width, height);
    let (mut judged, mut wrong, mut dark, mut missing) = (0, 0, 0, 0);
    for (i, stored) in depth.iter().enumerate().filter(|(_, stored)| **stored > 0.0) {
        let pixel = [(i % width as usize) as i64, (i / width as usize) as i64];
        let ray = DVec3::from(view_ray(pixel, [width, height], [tx, ty]));
        let distance = Settings::default().near / f64::from(*stored);
        let at = eye + camera.rotation * ray * distance;
        let Some(floor) = rays.height(at.x, at.z).filter(|_| distance < 1200.0) else { continue };
        let place = DVec3::new(at.x, floor, at.z);
        // Near misses are not judged: the drawn surface is off by a few pixels.
        let clearance = rays.clearance(place, to_sun);
        if clearance.abs() < 0.03 {
            continue;
        }
        judged += 1;
        dark += usize::from(clearance < 0.0);
        wrong += usize::from((all[i] > 127) != (clearance > 0.0));
        missing += usize::from(seen[i] > 127 && clearance < 0.0);
    }
    assert!(judged > 2000 && dark * 10 > judged, "{judged} {dark}");
    assert!(wrong * 50 < judged, "{wrong} of {judged} pixels have the wrong light, {dark} are dark");
    assert!(missing > 4 * wrong, "no shadow comes from out of view: {missing} {wrong} of {judged}");
}

/// Height of the ground below a place.
pub(super) fn ground_height(entry: &TerrainEntry, x: f64, z: f64) -> f64 {
    let terrain = terrain(entry);
    let mut heights = Vec::new();
    let [x, z] = [x, z].map(|v| (v / f64::from(entry.unit)).floor() as i64);
    terrain.window(terrain.finest_level(), x, z, 2, 2, &mut Scratch::new(), &mut heights).unwrap();
    f64::from(*heights.iter().max().unwrap()) * f64::from(entry.height_unit)
}

#[test]
fn terrain_for_looking_at() {
    let Some(mut h) = headless(640, 360) else { return };
    let entry = entry(3);
    let mut ground = scene(&h, &entry);
    let low = DVec3::new(40.0, ground_height(&entry, 40.0, 60.0) + 2.0, 60.0);
    let near = Pose::look_at(low, low + DVec3::new(1.0, -0.05, 0.6), DVec3::Y, 0.9);
    let high = DVec3::new(0.0, 400.0, 0.0);
    let views = [
        ("terrain-near", near),
        ("terrain-hill", Pose::look_at(high, high + DVec3::new(1.0, -0.35, 0.3), DVec3::Y, 0.9)),
        ("terrain-high", Pose::look_at(high * 10.0, high * 10.0 + DVec3::new(1.0, -0.8, 0.3), DVec3::Y, 0.9)),
        ("terrain-space", Pose::look_at(high * 120.0, DVec3::new(1.0, 0.0, 0.0), DVec3::Y, 0.9)),
    ];
    let mut rough = scene(&h, &rough_entry(3));
    let crest = DVec3::new(-600.0, ground_height(&rough_entry(3), -600.0, -1500.0) + 120.0, -1500.0);
    let camera = Pose::look_at(crest, DVec3::new(200.0, 60.0, 0.0), DVec3::Y, 0.9);
    for (px, name) in [(1.0, "terrain-rough"), (4.0, "terrain-rough-coarse")] {
        draw(&mut h, &mut rough, camera, px, Settings::default());
        keep(&h, name);
        println!("{name}: {} tiles at {:.2} px", rough.frame().parts.len(), rough.drawn_px());
    }
    let levels = Settings { debug_view: DebugView::Level, wireframe: true, ..Settings::default() };
    draw(&mut h, &mut rough, camera, 4.0, levels);
    keep(&h, "terrain-rough-levels");
    for (name, camera) in views {
        let picture = draw(&mut h, &mut ground, camera, 1.0, Settings::default());
        keep(&h, name);
        println!("{name}: {} tiles at {:.2} px", ground.frame().parts.len(), ground.drawn_px());
        let levels = Settings { debug_view: DebugView::Level, wireframe: true, ..Settings::default() };
        let other = draw(&mut h, &mut ground, camera, 4.0, levels);
        keep(&h, &format!("{name}-levels"));
        assert!(compare(&picture, &other, None).unwrap().max_difference > 8);
    }
}

#[test]
fn a_coarse_surface_is_lit_like_a_finer_one() {
    let Some(mut h) = headless(640, 360) else { return };
    let entry = entry(3);
    let mut ground = scene(&h, &entry);
    let high = DVec3::new(0.0, 400.0, 0.0);
    let camera = Pose::look_at(high, high + DVec3::new(1.0, -0.35, 0.3), DVec3::Y, 0.9);
    let [fine, coarse] = [0.5, 2.4].map(|px| draw(&mut h, &mut ground, camera, px, Settings::default()));
    let found = compare(&coarse, &fine, None).unwrap();
    // SSIM is 0.92, as with normals of vertices at 1 px; with those of vertices at 2.4 px it would be 0.81.
    assert!(found.ssim > 0.88, "{found:?}");
}

/// A camera above the middle of the world, at the height of a person to a tower, looking ahead or down.
fn random_camera(entry: &TerrainEntry, random: &mut Random) -> Pose {
    let mut place = || (random.unit() - 0.5) * 4000.0;
    let (x, z) = (place(), place());
    let over = 1.5 + 300.0 * random.unit().powi(3);
    let eye = DVec3::new(x, ground_height(entry, x, z) + over, z);
    let (turn, pitch) = (random.unit() * std::f64::consts::TAU, -0.6 + 0.65 * random.unit());
    let ahead = DVec3::new(turn.cos(), pitch, turn.sin());
    Pose::look_at(eye, eye + ahead, DVec3::Y, 0.5 + 0.7 * random.unit())
}

/// Direction of a pixel, scaled to a depth of one.
fn ray(camera: &Pose, (width, height): (u32, u32), x: u32, y: u32) -> DVec3 {
    let (tx, ty) = camera.tan_half_fov(width, height);
    let ndc = [
        (f64::from(x) + 0.5) / f64::from(width) * 2.0 - 1.0,
        1.0 - (f64::from(y) + 0.5) / f64::from(height) * 2.0,
    ];
    camera.rotation * DVec3::new(ndc[0] * tx, ndc[1] * ty, -1.0)
}

#[test]
fn no_background_shows_through_the_ground() {
    let Some(mut h) = headless(320, 180) else { return };
    let size = h.size();
    let mut random = Random::new(11);
    for number in 0..20 {
        let entry = alternating_entry(number);
        let mut ground = scene(&h, &entry);
        let camera = random_camera(&entry, &mut random);
        let px = 0.7 + 8.0 * random.unit();
        draw(&mut h, &mut ground, camera, px, Settings::default());
        let depth = h.depth().unwrap();
        // From the middle of the world its edge is 14 km away, and no ground lies deeper than 400 m.
        let steep = |ray: DVec3| ray.y / ray.x.hypot(ray.z) < -(camera.eye.y + 400.0) / 12_000.0;
        let mut below = 0;
        for y in 0..size.1 {
            for x in 0..size.0 {
                if steep(ray(&camera, size, x, y)) {
                    below += 1;
                    let gap = depth[(y * size.0 + x) as usize] <= 0.0;
                    assert!(!gap, "camera {number} at {px:.2} px: background at {x}, {y}");
                }
            }
        }
        assert!(below > 2000, "camera {number} sees hardly any ground");
    }
}

/// Where a ray (one unit deep) first meets a triangle, in depth.
fn hit(ray: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    // Möller and Trumbore 1997, from the origin.
    let (ab, ac) = (b - a, c - a);
    let p = ray.cross(ac);
    let det = ab.dot(p);
    if det.abs() < 1e-300 {
        return None;
    }
    let t = -a;
    let u = t.dot(p) / det;
    let q = t.cross(ab);
    let v = ray.dot(q) / det;
    let depth = ac.dot(q) / det;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && depth > 0.0).then_some(depth)
}

#[test]
fn pictures_show_what_the_cpu_reference_computes_and_stay_within_the_screen_error() {
    let Some(mut h) = headless(240, 135) else { return };
    let size = h.size();
    let mut random = Random::new(5);
    for number in 0..4 {
        let entry = alternating_entry(40 + number);
        let mut ground = scene(&h, &entry);
        let placed = PlacedTerrain::new(terrain(&entry).into(), entry.unit.into(), entry.height_unit.into());
        let mut camera = random_camera(&entry, &mut random);
        if number % 2 == 1 {
            // Over the crest, some hundred metres away.
            let x = 400.0 * random.unit() - 500.0;
            let aim = DVec3::new(x, ground_height(&entry, x, 0.55 * x - 300.0), 0.55 * x - 300.0);
            let eye = aim + DVec3::new(300.0 * random.unit(), 140.0, 500.0 + 400.0 * random.unit());
            camera = Pose::look_at(eye, aim, DVec3::Y, 0.6);
        }
        let px = 6.0;
        draw(&mut h, &mut ground, camera, px, Settings::default());
        let depth = h.depth().unwrap();

        // The triangles that the CPU reference makes of the same tiles.
        let frame = ground.frame();
        let eye = DVec2::new(camera.eye.x, camera.eye.z);
        let near = |region: &TileRegion| TileRegion {
            from: region.from - eye,
            to: region.to - eye,
            ..region.clone()
        };
        let regions: Vec<TileRegion> = frame.regions.iter().map(near).collect();
        let (unit, height_unit) = (f64::from(entry.unit), f64::from(entry.height_unit));
        let mut triangles: Vec<[DVec3; 3]> = Vec::new();
        for part in frame.parts {
            let side = i64::from(TILE_CELLS) << part.spacing;
            let [x, y] = part.origin.map(|o| o.div_euclid(side) as i32);
            let mut heights = Vec::new();
            placed.heights(TileId { spacing: part.spacing, x, y }, &mut Scratch::new(), &mut heights);
            let tile = Tile {
                heights: &heights,
                corner: [
                    part.origin[0] as f64 * unit - camera.eye.x,
                    part.origin[1] as f64 * unit - camera.eye.z,
                ],
                step: f64::from(1_u32 << part.spacing) * unit,
                height_unit,
                eye_height: camera.eye.y,
                above: frame.above,
                morph: part.morph,
                spacing: part.spacing,
                regions: &regions,
            };
            let half = TILE_CELLS / 2;
            for row in 0..TILE_CELLS {
                for column in 0..TILE_CELLS {
                    if part.quadrants & (1 << (row / half * 2 + column / half)) == 0 {
                        continue;
                    }
                    let at = |c, r| DVec3::from(tile.place(column + c, row + r));
                    triangles.push([at(0, 0), at(1, 1), at(1, 0)]);
                    triangles.push([at(0, 0), at(0, 1), at(1, 1)]);
                }
            }
        }

        let terrain = terrain(&entry);
        let (mut looked_at, mut silhouettes, mut worst) = (0, 0, 0.0_f64);
        for _ in 0..150 {
            let (x, y) = (random.below(size.0 as usize) as u32, random.below(size.1 as usize) as u32);
            let ray = ray(&camera, size, x, y);
            let met = triangles.iter().filter_map(|t| hit(ray, *t)).fold(f64::INFINITY, f64::min);
            let stored = f64::from(depth[(y * size.0 + x) as usize]);
            let drawn = if stored > 0.0 { Settings::default().near / stored } else { f64::INFINITY };
            if met.is_infinite() && drawn.is_infinite() {
                continue;
            }
            looked_at += 1;
            let agrees = (drawn - met).abs() <= 3e-4 * met;
            if !agrees {
                // At a silhouette of a hill, a rounding error decides which hill is visible.
                silhouettes += 1;
                continue;
            }
            // Compared with the finest level.
            let at = camera.eye + ray * met;
            let exact = terrain.height_between(at.x / unit, at.z / unit, &mut Scratch::new()) * height_unit;
            let (_, ty) = camera.tan_half_fov(size.0, size.1);
            worst = worst.max((at.y - exact).abs() * f64::from(size.1) / (2.0 * ty) / met);
        }
        println!(
            "camera {number}: {looked_at} pixels, {silhouettes} silhouettes, {} tiles, {} regions, worst {worst:.2} of {px} px",
            frame.parts.len(),
            frame.regions.len()
        );
        assert_eq!(frame.regions.is_empty(), number % 2 == 0);
        assert!(looked_at > 40 && silhouettes * 30 <= looked_at, "{silhouettes} of {looked_at}");
        assert!(worst <= px, "camera {number}: {worst:.2} px");
    }
}

/// The results of a function of `terrain.wgsl` for pairs of numbers: `call` computes four numbers from `given`.
/// `uniforms` are the blocks that it uses, by binding.
pub(crate) fn compute(
    gpu: &Gpu,
    call: &str,
    uniforms: &[(u32, &[u8])],
    places: &[[f32; 2]],
) -> Vec<[f32; 4]> {
    let entry = format!(
        "@group(2) @binding(0) var<storage, read> places: array<vec2<f32>>;
        @group(2) @binding(1) var<storage, read_write> found: array<vec4<f32>>;
        @compute @workgroup_size(64)
        fn cs_compute(@builtin(global_invocation_id) id: vec3<u32>) {{
            if (id.x < arrayLength(&places)) {{
                let given = places[id.x];
                found[id.x] = {call};
            }}
        }}"
    );
    let source = format!("{}{entry}", wgsl!("common", "targets", "anisotropic", "ground", "terrain"));
    let device = &gpu.device;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("compute"),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("compute"),
        layout: None,
        module: &module,
        entry_point: Some("cs_compute"),
        compilation_options: Default::default(),
        cache: None,
    });
    let buffer = |contents: &[u8], usage| {
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
    };
    let uniforms: Vec<_> = uniforms
        .iter()
        .map(|(binding, bytes)| (*binding, buffer(bytes, wgpu::BufferUsages::UNIFORM)))
        .collect();
    let given = buffer(bytemuck::cast_slice(places), wgpu::BufferUsages::STORAGE);
    let size = 16 * places.len() as u64;
    let found = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    let group = |index, entries: &[wgpu::BindGroupEntry<'_>]| {
        let layout = &pipeline.get_bind_group_layout(index);
        device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries })
    };
    let blocks: Vec<_> = uniforms
        .iter()
        .map(|(binding, block)| wgpu::BindGroupEntry {
            binding: *binding,
            resource: block.as_entire_binding(),
        })
        .collect();
    let terrain = group(1, &blocks);
    let lists = group(
        2,
        &[
            wgpu::BindGroupEntry { binding: 0, resource: given.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: found.as_entire_binding() },
        ],
    );
    let mut encoder = device.create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(1, &terrain, &[]);
        pass.set_bind_group(2, &lists, &[]);
        pass.dispatch_workgroups(places.len().div_ceil(64) as u32, 1, 1);
    }
    let read = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size,
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    encoder.copy_buffer_to_buffer(&found, 0, &read, 0, size);
    gpu.queue.submit([encoder.finish()]);
    read.map_async(wgpu::MapMode::Read, .., |mapped| mapped.unwrap());
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let bytes = read.get_mapped_range(..).unwrap();
    bytemuck::cast_slice(&bytes).to_vec()
}

#[test]
fn zone_weights_are_the_cpu_references_and_sum_to_one() {
    let Some(h) = headless(16, 16) else { return };
    let zones = [-6.0, 105.0, 230.0, 8.9_f32];
    let places: Vec<[f32; 2]> = (0..64)
        .flat_map(|i| (0..=32).map(move |j| [i as f32 * 5.3 - 40.0, j as f32 / 32.0]))
        .chain([[f32::from(u16::MAX) * 1e3, 1.0], [-1e9, 0.0]])
        .collect();
    let mut mixed = 0;
    // `zones` follow eight numbers in the uniform block of 20.
    let mut uniform = [0.0_f32; 20];
    uniform[8..12].copy_from_slice(&zones);
    let uniform = bytemuck::cast_slice(&uniform);
    let found = compute(h.gpu(), "zone_weights(given.x, given.y)", &[(0, uniform)], &places);
    for (place, found) in places.iter().zip(found) {
        let expected = zone_weights(zones.map(f64::from), place[0].into(), place[1].into());
        for (found, expected) in found.iter().zip(expected) {
            assert!((f64::from(*found) - expected).abs() < 1e-5, "{place:?}: {found}, {expected}");
        }
        assert!((found.iter().sum::<f32>() - 1.0).abs() < 1e-6, "{place:?}: {found:?}");
        mixed += usize::from(found.iter().filter(|&&weight| weight > 0.01).count() > 1);
    }
    assert!(mixed > 100, "{mixed} places with more than one zone");
}

#[test]
fn terrain_counts_in_overdraw() {
    let Some(mut h) = headless(96, 54) else { return };
    let mut ground = scene(&h, &entry(7));
    let camera = Pose::look_at(DVec3::new(0.0, 260.0, 900.0), DVec3::new(0.0, 60.0, 0.0), DVec3::Y, 0.9);
    let settings = Settings { debug_view: DebugView::Overdraw, ..Settings::default() };
    draw(&mut h, &mut ground, camera, 4.0, settings);
    let counts: Vec<half::f16> =
        bytemuck::pod_collect_to_vec(&h.intermediate(Resource::Overdraw, 2).unwrap());
    let seen = h.coverage().unwrap();
    assert!(seen.contains(&true) && seen.contains(&false));
    for (count, seen) in counts.iter().zip(seen) {
        assert!((count.to_f32() >= 1.0) == seen, "{count}");
    }
}
