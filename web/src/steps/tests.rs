use super::*;
use lodestream_scene::description::Instance;
use lodestream_scene::placement::Placement;
use lodestream_scene::proxy::{Cut, PartialProxy, Proxy};

fn vertex_of(level: u32) -> Vertex {
    Vertex {
        data: RenderVertex {
            position: [1.5, -2.0, 3.25],
            normal: [0.0, 1.0, 0.0],
            uv: [0.25, 0.75],
            color: [1, 2, 3, 4],
            morph_from: [-1.0, 0.5, f32::MAX],
            smooth: level % 2 == 1,
            part: (level * 4093) & 0xF_FFFF,
            skin: Skin::new([(level as u8 % 5, 0.25), (9, 0.75)]),
            second_uv: [f32::from(level as u8), -0.5],
        },
        birth_s: 12.5,
        level,
    }
}

fn step() -> Vec<Change> {
    let spot = Spot { direction: [0.0, -1.0, 0.0], inner: 0.1, outer: 0.5 };
    let light =
        PunctualLight { position: [1.0, 2.0, 3.0], intensity: [4.0; 3], range: 5.0, spot: Some(spot) };
    let point = |x, mode| HeightOverride { x, y: 3, mode, height: -7 };
    let points = vec![point(1, Mode::Fixed), point(2, Mode::Additive)];
    vec![
        Change::PunctualLights { count: 1 },
        Change::PunctualLightPage {
            page: 0,
            punctual_lights: [light, PunctualLight { spot: None, ..light }].into(),
        },
        Change::Proxies(vec![Proxy { asset: 3, instance_count: 9, error: 0.5, ..Proxy::default() }]),
        Change::Cut(Cut {
            proxies: vec![0, 7],
            instances: 9,
            covered: vec![[0, 3], [5, 9]],
            partial: vec![PartialProxy { proxy: 7, hidden: vec![[1, 2]] }],
        }),
        Change::Instances(vec![Instance { asset: 7, placement: Placement::at([1e6, 0.0, -1.0]) }]),
        Change::Asset(NewAsset {
            asset: 7,
            origin: [0.5; 3],
            center: [1.0; 3],
            radius: 2.0,
            materials: vec![Default::default()],
            textures: Vec::new(),
            shared: Vec::new(),
        }),
        Change::Mesh(MeshChange {
            asset: 7,
            vertices: vec![(0, vec![vertex_of(0), vertex_of(3)]), (9, vec![vertex_of(12)])],
            indices: vec![IndexRun { material: 0, first: 2, faces: vec![[0, 1, 0x0102_0304], [0; 3]] }],
            vertex_slots: 10,
            index_slots: vec![4, 0],
        }),
        Change::FirstFrame,
        Change::Texture(TextureChange {
            asset: 7,
            texture: 1,
            level: 2,
            tile: None,
            pixels: TexturePixels::R16(vec![0, 0x1234, u16::MAX]).into(),
        }),
        Change::Texture(TextureChange {
            asset: 7,
            texture: 0,
            level: 0,
            tile: None,
            pixels: TexturePixels::Rgba8(vec![1, 2, 3, 4]).into(),
        }),
        Change::Texture(TextureChange {
            asset: 7,
            texture: 2,
            level: 0,
            tile: Some(3),
            pixels: TexturePixels::Held { number: 70_000, bytes: 256 }.into(),
        }),
        Change::HeightOverrides { x: -3, y: 5, overrides: HeightOverrides::new(15, points).unwrap() },
    ]
}

#[test]
fn a_step_comes_back_as_it_was() {
    let step = step();
    let back = decode(&encode(&step).unwrap()).unwrap();
    assert_eq!(format!("{back:?}"), format!("{step:?}"));
}

#[test]
fn a_cut_step_is_an_error_at_every_length() {
    let bytes = encode(&step()).unwrap();
    for end in 0..bytes.len() {
        assert!(decode(&bytes[..end]).is_err(), "{end} of {} bytes", bytes.len());
    }
    assert!(decode(&[&bytes[..], &[0]].concat()).is_err(), "a byte too many");
}

#[test]
fn a_file_is_not_passed_as_texels() {
    let pixels = TexturePixels::File {
        file: bytes::Bytes::new(),
        kind: lodestream_scene::asset::TextureKind::Color,
        size: [1, 1],
        planes: None,
    };
    let change = TextureChange { asset: 0, texture: 0, level: 0, tile: None, pixels: pixels.into() };
    assert_eq!(encode(&[Change::Texture(change)]), Err(StepError::File));
}

#[test]
fn an_unknown_kind_is_named() {
    assert_eq!(decode(&[1, 99]).unwrap_err(), StepError::Kind(99));
}
