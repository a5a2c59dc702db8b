//! What a scene has besides meshes: terrain, punctual lights, names of parts, animations.

use lodestream_scene::animation::{
    AnimatedModel, AnimatedNode, AnimatedPart, AnimatedSkin, Channel, Clip, Interpolation, Property, Rest,
    SkinJoint,
};
use lodestream_scene::parts::{self, PartInfo};
use lodestream_scene::placement::Placement;
use lodestream_scene::punctual_lights::{
    PunctualLight, PunctualLightPageEntry, Spot, encode_directory, encode_page,
};
use lodestream_terrain::{
    Distribution, Erosion, HeightOverride, HeightOverrides, Mode, Parameters, Shape, Stamp, encode_points,
    encode_stamps,
};

use super::seed::seed;

/// A point light, a spot light, and others with equal parameters.
pub(super) fn some_punctual_lights() -> Vec<PunctualLight> {
    let bulb =
        PunctualLight { position: [1.0, 2.0, -3.5], intensity: [40.0, 20.0, 0.0], range: 12.0, spot: None };
    let cone = Spot { direction: [0.0, -0.8, 0.6], inner: 0.25, outer: 0.75 };
    let spot = PunctualLight { position: [5.0, 2.0, -3.5], spot: Some(cone), ..bulb };
    let far = PunctualLight { position: [1e9, -7.25, 0.0], intensity: [1e6; 3], range: 0.5, spot: None };
    vec![
        bulb,
        spot,
        PunctualLight { position: [9.0, 2.0, 0.0], ..spot },
        far,
        PunctualLight { range: 12.0, ..far },
    ]
}

pub(super) fn punctual_lights() -> Vec<(String, Vec<u8>)> {
    let some = some_punctual_lights();
    let page = |punctual_lights: &[PunctualLight]| encode_page(punctual_lights).expect("a page is encoded");
    let listed = |punctual_lights: &[PunctualLight]| {
        PunctualLightPageEntry::of(punctual_lights, page(punctual_lights).len() as u32)
    };
    let street: Vec<PunctualLight> = (0..64)
        .map(|n| PunctualLight {
            position: [5.0 * f64::from(n), 6.0, f64::from(n % 2) * 8.0],
            ..some[n as usize % 3]
        })
        .collect();
    let directory = |count: usize| {
        let entries: Vec<PunctualLightPageEntry> =
            (0..count).map(|n| listed(&street[..1 + n % 64])).collect();
        encode_directory(&entries).expect("a directory is encoded")
    };
    let with = |kind: u8, count: u8, bytes: Vec<u8>| [&[kind, count], &bytes[..]].concat();
    vec![
        seed("bulb", with(0, 1, page(&some[..1]))),
        seed("all-kinds", with(0, 5, page(&some))),
        seed("street", with(0, 64, page(&street))),
        seed("directory", with(1, 9, directory(9))),
        seed("few", with(2, 5, page(&some))),
        seed("few-pages", with(2, 200, directory(4))),
    ]
}

pub(super) fn parts() -> Vec<(String, Vec<u8>)> {
    let called = |n: u32| PartInfo {
        name: format!("door {n}"),
        path: format!("site/building {}/floor {}", n / 9, n % 3),
        extras: n.is_multiple_of(2).then(|| format!("{{\"number\":{n}}}")),
        ..PartInfo::default()
    };
    let page = |count: u32| {
        let records: Vec<PartInfo> = (0..count).map(called).collect();
        parts::encode_page(&records).expect("a page is encoded")
    };
    let directory =
        |ranges: &[std::ops::Range<u32>]| parts::encode_directory(ranges).expect("a directory is encoded");
    let with = |kind: u8, count: u32, bytes: Vec<u8>| [&[kind, (count - 1) as u8], &bytes[..]].concat();
    // Names as long as they may be, the second like the first.
    let longest = PartInfo {
        name: "n".repeat(parts::MAX_NAME_BYTES),
        path: "p".repeat(parts::MAX_PATH_BYTES),
        extras: Some(format!("\"{}\"", "e".repeat(parts::MAX_EXTRAS_BYTES - 2))),
        ..PartInfo::default()
    };
    let long = parts::encode_page(&[longest.clone(), longest]).expect("a page is encoded");
    // Doors in a row far from the origin, the last turned.
    let mut row: Vec<PartInfo> = (0..12)
        .map(|n| {
            let in_file = Placement::at([408_201.5 + f64::from(n), 17.0, 4_080_928.0]);
            PartInfo { in_file, ..called(n) }
        })
        .collect();
    row[11].in_file.rotation = [0.0, 0.6, 0.0, 0.8];
    let row = parts::encode_page(&row).expect("a page is encoded");
    // Instances of three models in turn.
    let many: Vec<_> = (0..200).map(|n| [0..1, 1..8, 8..9][n % 3].clone()).collect();
    vec![
        seed("one", with(0, 1, page(1))),
        seed("some", with(0, 20, page(20))),
        seed("whole-page", with(0, 256, page(256))),
        seed("long", with(0, 2, long)),
        seed("placed", with(0, 12, row)),
        seed("directory", with(1, 4, directory(&[0..300, 300..301, 300..301, 301..302]))),
        seed("many-instances", with(1, 200, directory(&many))),
        seed("animation", with(2, 1, door())),
    ]
}

/// A door that turns on a hinge, with a handle that jumps and a light that grows on a spline.
fn door() -> Vec<u8> {
    let node = |parent, translation| AnimatedNode {
        parent,
        to_parent: Default::default(),
        rest: Rest { translation, ..Rest::default() },
    };
    let channel = |node, property, interpolation, timeline, values: &[f32]| Channel {
        node,
        property,
        interpolation,
        timeline,
        values: values.to_vec(),
    };
    let turn = [0.0, 0.0, 0.0, 1.0, 0.0, 0.6, 0.0, 0.8];
    let channels = vec![
        channel(0, Property::Rotation, Interpolation::Linear, 0, &turn),
        channel(1, Property::Translation, Interpolation::Step, 1, &[0.0, 0.5, 1.0, 0.0, 0.25, 1.0]),
        channel(1, Property::Scale, Interpolation::CubicSpline, 0, &[1.0; 18]),
    ];
    let part = |node| AnimatedPart { node, to_node: Default::default(), from_model: Default::default() };
    let joint = |node| SkinJoint { node, to_node: Default::default() };
    let model = AnimatedModel {
        nodes: vec![node(None, [0.5, 1e6 + 0.1, 0.0]), node(Some(0), [0.5, 1.0, 0.0])],
        parts: vec![part(0), part(1)],
        skins: vec![AnimatedSkin { joints: vec![joint(Some(0)), joint(None)] }],
        places: vec![vec![0, 1, 2], vec![7, 300, 9]],
        timelines: vec![vec![0.0, 1.5], vec![0.25, 2.0]],
        clips: vec![
            Clip { name: "open".into(), channels },
            Clip { name: "shut".into(), channels: Vec::new() },
        ],
    };
    model.to_bytes().expect("a model is encoded")
}

pub(super) fn terrain() -> Vec<(String, Vec<u8>)> {
    let erosion = Erosion { level: 7, passes: 5, talus: 300, spike_limit: 8 };
    let eroded =
        Parameters { seed: 5, erosion, distribution: Distribution::Gaussian, ..Parameters::default() };
    let parameters = [("parameters", Parameters::default()), ("eroded", eroded)]
        .map(|(name, parameters)| seed(name, [&[0], &parameters.encode()[..]].concat()));
    let line = vec![[-5, 0], [3000, 70], [2000, 900]];
    let shapes = [
        Shape::Ridge { from: [0, 1], to: [100, -50], half_width: 20, height: 900 },
        Shape::Valley { from: [1 << 31, 0], to: [(1 << 31) - 9, 9], half_width: 1, depth: 7000 },
        Shape::Crater { centre: [60, -60], radius: 50, depth: i32::MAX, rim: i32::MIN },
        Shape::Plateau { centre: [-99, 0], radius: 300, falloff: 0, height: 12 },
        Shape::RiverBed { line, half_width: 1 << 20, depth: 3 },
    ];
    let stamp = |(i, shape)| Stamp { mode: if i % 2 == 0 { Mode::Fixed } else { Mode::Additive }, shape };
    let stamps =
        encode_stamps(&(0..).zip(shapes).map(stamp).collect::<Vec<_>>()).expect("stamps are encoded");
    let list = |name: &str, level: u8, points: &mut dyn Iterator<Item = (u16, u16, i32, bool)>| {
        let point = |(x, y, height, fixed)| HeightOverride {
            x,
            y,
            mode: if fixed { Mode::Fixed } else { Mode::Additive },
            height,
        };
        let points =
            HeightOverrides::new(level, points.map(point).collect()).expect("points are in the patch");
        let bytes = encode_points(level, &points).expect("points are encoded");
        seed(name, [&[2, level - 1], &bytes[..]].concat())
    };
    let lists = [
        list("none", 1, &mut std::iter::empty()),
        list("one", 12, &mut std::iter::once((4096, 0, i32::MIN, true))),
        list(
            "band",
            6,
            &mut (0..65).flat_map(|y| (y / 2..y / 2 + 9).map(move |x| (x, y, i32::from(x * y), false))),
        ),
        list("scattered", 12, &mut (0..40).map(|i| (i * 101, i * i * 2, i32::from(i) << 20, i % 3 == 0))),
        list("lattice", 10, &mut (0..100).map(|i| (i % 10 * 100, i / 10 * 64, -25 * i32::from(i % 7), true))),
    ];
    let mut seeds = vec![seed("stamps", [&[1], &stamps[..]].concat())];
    seeds.extend(parameters);
    seeds.extend(lists);
    seeds
}
