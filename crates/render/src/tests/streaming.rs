//! Data that arrives bit by bit: growing buffers, textures by level, morphing.

use glam::DVec3;

use super::headless;
use super::shapes::{asset, at, fill, quad, sphere};
use crate::image_compare::compare;
use crate::{
    AssetGpu, Drawable, Frame, Headless, Material, PackedVertex, Placement, Pose, RenderError, Texture,
    TextureData, TextureKind, TextureShape,
};

fn camera() -> Pose {
    Pose::look_at(DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, DVec3::Y, 0.8)
}

fn shoot(h: &mut Headless, asset: &AssetGpu) -> image::RgbaImage {
    shoot_with(h, asset, false)
}

fn shoot_with(h: &mut Headless, asset: &AssetGpu, wireframe: bool) -> image::RgbaImage {
    let drawables = [Drawable { asset, instances: &[Placement::default()] }];
    let mut frame = Frame::new(camera(), &drawables);
    frame.settings.wireframe = wireframe;
    h.frame(&frame).unwrap();
    h.picture().unwrap()
}

#[test]
fn scattered_slots_are_uploaded_where_they_belong() {
    let Some(mut h) = headless(64, 64) else { return };
    let mesh = sphere(16);
    let whole = asset(&h, &mesh, Material::default());
    let want = shoot(&mut h, &whole);
    // Start from a sphere with every seventh vertex and every fifth face wrong.
    let mut bad = mesh.clone();
    let wrong = |n: usize, step: usize| (0..n as u32).step_by(step).collect::<Vec<_>>();
    let (slots, faces) = (wrong(mesh.0.len(), 7), wrong(mesh.1.len(), 5));
    slots.iter().for_each(|s| bad.0[*s as usize].position = [0.0; 3]);
    faces.iter().for_each(|f| bad.1[*f as usize] = [1, 1, 2]);
    let mut mended = asset(&h, &bad, Material::default());
    assert_ne!(shoot(&mut h, &mended), want);
    mended.update_vertex_slots(h.gpu(), &slots, |slot| mesh.0[slot as usize]).unwrap();
    mended.update_index_slots(h.gpu(), 0, &faces, &mesh.1).unwrap();
    assert_eq!(shoot(&mut h, &mended), want);
    let past = mended.update_index_slots(h.gpu(), 0, &[mesh.1.len() as u32], &mesh.1);
    assert!(matches!(past, Err(RenderError::NoSuch { what: "face slot", .. })));
}

#[test]
fn piecewise_uploads_equal_one_upload() {
    let Some(mut h) = headless(64, 64) else { return };
    let mesh = sphere(16);
    let whole = asset(&h, &mesh, Material::default());
    let want = shoot(&mut h, &whole);

    let mut parts = h.renderer().create_asset(h.gpu(), DVec3::ZERO, &[Material::default()], &[]);
    // Faces before vertices, uneven pieces, several growths, and a rewrite of existing data.
    for (i, piece) in mesh.1.chunks(37).enumerate() {
        parts.update_indices(h.gpu(), 0, i * 37, piece).unwrap();
    }
    for (i, piece) in mesh.0.chunks(11).enumerate() {
        parts.update_vertices(h.gpu(), i * 11, &vec![PackedVertex::default(); piece.len()]).unwrap();
        parts.update_vertices(h.gpu(), i * 11, piece).unwrap();
    }
    assert_eq!(shoot(&mut h, &parts), want);

    // Unused face slots draw nothing, not even as wireframe.
    let wires = shoot_with(&mut h, &parts, true);
    assert_ne!(wires, want);
    parts.update_indices(h.gpu(), 0, mesh.1.len(), &[[0; 3]; 500]).unwrap();
    assert_eq!(shoot(&mut h, &parts), want);
    assert_eq!(shoot_with(&mut h, &parts, true), wires);
    // Slots that are freed are not drawn.
    parts.truncate_indices(0, 0);
    shoot(&mut h, &parts);
    assert!(h.coverage().unwrap().iter().all(|c| !c));
}

#[test]
fn unknown_names_and_wrong_sizes_are_errors() {
    let Some(h) = headless(8, 8) else { return };
    let shape = TextureShape::full(4, 4, TextureKind::Color);
    let mut a = h.renderer().create_asset(h.gpu(), DVec3::ZERO, &[Material::default()], &[shape]);
    let g = h.gpu();
    assert!(matches!(a.update_indices(g, 1, 0, &[]), Err(RenderError::NoSuch { what: "material", .. })));
    let texture =
        |a: &mut AssetGpu, i, level, bytes| a.update_texture(g, i, level, TextureData::Rgba8(bytes));
    assert!(matches!(texture(&mut a, 1, 0, &[]), Err(RenderError::NoSuch { what: "texture", .. })));
    assert!(matches!(texture(&mut a, 0, 9, &[]), Err(RenderError::NoSuch { what: "texture level", .. })));
    assert!(matches!(texture(&mut a, 0, 0, &[0; 5]), Err(RenderError::LevelSize { .. })));
    let far = a.update_vertices(g, usize::MAX - 1, &[PackedVertex::default()]);
    assert!(matches!(far, Err(RenderError::TooLarge { .. })));
    assert!(g.take_error().is_none());
}

#[test]
fn shared_textures_exist_once_while_in_use() {
    let Some(mut h) = headless(16, 16) else { return };
    let mesh = quad([-1.0, -1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], 1.0);
    let shape = TextureShape { levels: 2, ..TextureShape::full(8, 8, TextureKind::Color) };
    let material = Material { base_color: [1.0; 4], base_color_texture: Some(0), ..Material::default() };
    let texture = Texture::new(h.gpu(), shape);
    let [mut one, mut other] = [(); 2].map(|()| {
        let textures = vec![texture.clone()];
        let mut asset =
            h.renderer().create_asset_with(h.gpu(), DVec3::ZERO, std::slice::from_ref(&material), textures);
        fill(&h, &mut asset, &mesh);
        asset
    });
    let weak = texture.downgrade();
    drop(texture);
    let white = shoot(&mut h, &other);
    for level in 0..2 {
        let (width, height) = shape.level_size(level);
        let red = [200, 30, 20, 255].repeat((width * height) as usize);
        one.update_texture(h.gpu(), 0, level, TextureData::Rgba8(&red)).unwrap();
        // The texture is used already: other texels do not change the picture.
        let blue = [20, 30, 200, 255].repeat((width * height) as usize);
        other.update_texture(h.gpu(), 0, level, TextureData::Rgba8(&blue)).unwrap();
    }
    let red = shoot(&mut h, &one);
    assert_ne!(red, white);
    assert_eq!(shoot(&mut h, &other), red);
    let texels = (8 * 8 + 4 * 4) * 4;
    assert_eq!(weak.upgrade().map(|texture| texture.bytes()), Some(texels));
    // An asset created later has the textures that have arrived.
    let later = vec![weak.upgrade().unwrap()];
    let mut later =
        h.renderer().create_asset_with(h.gpu(), DVec3::ZERO, std::slice::from_ref(&material), later);
    fill(&h, &mut later, &mesh);
    assert_eq!(shoot(&mut h, &later), red);
    drop((one, later));
    assert_eq!(shoot(&mut h, &other), red);
    assert!(weak.upgrade().is_some());
    drop(other);
    assert!(weak.upgrade().is_none());
}

#[test]
fn a_texture_without_levels_shows_its_mean_colour() {
    let Some(mut h) = headless(16, 16) else { return };
    let mesh = quad([-1.0, -1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], 1.0);
    let (bytes, linear) = ([180, 90, 40, 255], [0.456_41, 0.102_24, 0.021_22]);
    let shape = TextureShape { mean: linear, ..TextureShape::full(4, 4, TextureKind::Color) };
    let material =
        Material { base_color: [0.5, 0.5, 0.5, 1.0], base_color_texture: Some(0), ..Material::default() };
    let mut a = h.renderer().create_asset(h.gpu(), DVec3::ZERO, std::slice::from_ref(&material), &[shape]);
    fill(&h, &mut a, &mesh);
    let before = shoot(&mut h, &a);
    for level in 0..shape.levels {
        let (w, height) = shape.level_size(level);
        let texels = bytes.repeat((w * height) as usize);
        a.update_texture(h.gpu(), 0, level, TextureData::Rgba8(&texels)).unwrap();
        let after = shoot(&mut h, &a);
        let off = before.as_raw().iter().zip(after.as_raw()).map(|(x, y)| x.abs_diff(*y)).max();
        assert!(off.is_some_and(|off| off <= 1), "level {level}: {off:?} off the mean");
    }
}

#[test]
fn texture_levels_sharpen_the_picture_in_any_order() {
    let Some(mut h) = headless(64, 64) else { return };
    let size = 64u32;
    let shape = TextureShape::full(size, size, TextureKind::Color);
    let material = Material { base_color: [1.0; 4], base_color_texture: Some(0), ..Material::default() };
    let mesh = quad([-1.0, -1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], 1.0);
    // The finest level is a checkerboard, each coarser one a flat colour of its own.
    let level_pixels = |level: u32| -> Vec<u8> {
        let (w, height) = shape.level_size(level);
        let pixel = |i: u32| match level {
            6 if (i % w / 8 + i / w / 8).is_multiple_of(2) => [255, 255, 255, 255],
            6 => [0, 0, 0, 255],
            l => [0, (l * 40) as u8, 255 - (l * 40) as u8, 255],
        };
        (0..w * height).flat_map(pixel).collect()
    };
    let make = |h: &Headless| {
        let mut a =
            h.renderer().create_asset(h.gpu(), DVec3::ZERO, std::slice::from_ref(&material), &[shape]);
        fill(h, &mut a, &mesh);
        a
    };
    let put = |h: &Headless, a: &mut AssetGpu, level: u32| {
        a.update_texture(h.gpu(), 0, level, TextureData::Rgba8(&level_pixels(level))).unwrap();
    };
    let mut coarse_first = make(&h);
    let untextured = shoot(&mut h, &coarse_first);
    let mut seen = vec![untextured];
    for level in 0..shape.levels {
        put(&h, &mut coarse_first, level);
        assert_eq!(coarse_first.finest_texture_level(0), Some(level));
        seen.push(shoot(&mut h, &coarse_first));
    }
    // Every level that arrived changed the picture.
    for pair in seen.windows(2) {
        assert!(compare(&pair[0], &pair[1], None).unwrap().max_difference > 5);
    }
    let mut shuffled = make(&h);
    for level in [6, 3, 0, 5, 1, 4] {
        put(&h, &mut shuffled, level);
    }
    assert_eq!(shuffled.finest_texture_level(0), Some(1), "level 2 is missing");
    put(&h, &mut shuffled, 2);
    assert_eq!(shuffled.finest_texture_level(0), Some(6));
    assert_eq!(&shoot(&mut h, &shuffled), seen.last().unwrap());
}

#[test]
fn new_vertices_move_from_where_they_split() {
    let Some(mut h) = headless(64, 64) else { return };
    let ground = quad([-0.5, -0.5, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0);
    let shifted = |dx: f32| {
        let move_by = |v: &PackedVertex| {
            PackedVertex::new([v.position[0] + dx, v.position[1], 0.0], [0.0, 0.0, 1.0], v.uv)
        };
        (ground.0.iter().map(move_by).collect::<Vec<_>>(), ground.1.clone())
    };
    let morphing: Vec<_> =
        shifted(0.4).0.iter().zip(&ground.0).map(|(v, from)| v.morphing(from.position, 10.0)).collect();
    let moving = asset(&h, &(morphing, ground.1.clone()), Material::default());
    let still_assets = [0.0, 0.2, 0.4].map(|dx| asset(&h, &shifted(dx), Material::default()));
    let mut frame_at = |asset: &AssetGpu, time_s: f32| {
        let drawables = [Drawable { asset, instances: &[at(0.0, 0.0, 0.0, 1.0)] }];
        let mut frame = Frame { time_s, ..Frame::new(camera(), &drawables) };
        frame.settings.morph_s = 0.5;
        h.frame(&frame).unwrap();
        h.picture().unwrap()
    };
    let (start, middle, end) = (frame_at(&moving, 10.0), frame_at(&moving, 10.25), frame_at(&moving, 10.5));
    let stills: Vec<_> = still_assets.iter().map(|m| frame_at(m, 0.0)).collect();
    assert_eq!([start, middle, end].as_slice(), stills.as_slice());
}
