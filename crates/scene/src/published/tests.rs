//! A published scene comes back as it was written, first things first.

use bytes::Bytes;
use lodestream_geometry::index::{ChunkInfo, Sphere, TruncationPoint, encode_page};

use super::*;
use crate::description::{AssetEntry, Camera, Instance, SceneHeader, SceneLighting, ScenePage};
use crate::parts::PartTable;

/// The index entry of a chunk of 100 bytes and more; every second has a truncation point.
fn info(chunk: u32) -> ChunkInfo {
    let point = TruncationPoint { payload_bytes: 50, error: 0.5, vertices: 1, wedges: 1, faces: 1 };
    ChunkInfo {
        level: 1,
        sphere: Sphere { center: [0.0; 3], radius: 1.0 },
        error: 1.0,
        attribute_error: 0.0,
        truncation_points: if chunk % 2 == 1 { vec![point] } else { Vec::new() },
        parents: Vec::new(),
        payload_bytes: 100 + chunk,
        vertices: 2,
        wedges: 2,
        faces: 2,
    }
}

/// Scene pages of two assets with an instance each.
fn contents(pages: u32) -> Contents {
    let page = |page: u32| ScenePage {
        page,
        first_asset: 2 * page,
        first_instance: 2 * page,
        assets: (0..2)
            .map(|n| AssetEntry { base_bytes: 3000 + n, chunk_count: 65, ..AssetEntry::default() })
            .collect(),
        instances: (0..2).map(|n| Instance::at(2 * page + n, [f64::from(page) * 10.0, 0.0, 0.0])).collect(),
        ..ScenePage::default()
    };
    let chunks = |first: u32, count: u32, offset: u64| {
        let infos: Vec<ChunkInfo> = (first..first + count).map(info).collect();
        let place = |info| {
            let place = ChunkPlace::of(info);
            let first = if place.cut > 0 { [1; 4] } else { [0; 4] };
            ChunkPlace { first, last: [2; 4], ..place }
        };
        let bytes = encode_page(&infos, first).unwrap().into();
        IndexPage { bytes, chunks: ChunkTable { offset, chunks: infos.iter().map(place).collect() } }
    };
    let pack = |n: u32| PackContents {
        key: [n as u8; 32],
        bytes: 1 << 20,
        base: vec![n as u8; 3000 + (n % 2) as usize].into(),
        index: vec![chunks(0, 64, 64), chunks(64, 1, 9000)],
        ..PackContents::default()
    };
    Contents {
        header: SceneHeader {
            name: "rows".into(),
            fingerprint: [0; 16],
            asset_count: 2 * pages,
            instance_count: 2 * pages,
            page_count: pages,
            light: SceneLighting { direction: [0.0, 1.0, 0.0], color: [1.0; 3], ambient: [0.2; 3] },
            background: [0.1; 3],
            terrain: None,
            camera: Camera { eye: [0.0, 0.0, 5.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 1.0 },
            root_slope: 0.0,
        },
        pages: (0..pages).map(page).collect(),
        terrain_directory: Vec::new(),
        height_overrides: Vec::new(),
        punctual_lights: None,
        light_directory: Vec::new(),
        light_pages: Vec::new(),
        parts: None,
        part_directory: Vec::new(),
        part_pages: Vec::new(),
        animations: Vec::new(),
        packs: (0..2 * pages).map(pack).collect(),
    }
}

#[test]
fn contents_come_back() {
    for pages in [1, 2, 40] {
        let contents = contents(pages);
        let object = Bytes::from(contents.encode().unwrap());
        let read = Contents::decode(&object).unwrap();
        assert_eq!(read, contents, "{pages} pages");
        assert_eq!(read.encode().unwrap(), object);
    }
}

#[test]
fn a_table_of_parts_comes_back() {
    let plain = contents(2);
    let parts = |records: u32, pages: u32| Contents {
        parts: Some(PartTable { records }),
        part_directory: vec![Bytes::from_static(b"directory")],
        part_pages: (0..pages).map(|n| n.to_le_bytes().to_vec().into()).collect(),
        ..plain.clone()
    };
    // As many pages as two tables list.
    let some = parts(256 * 256 + 1, 257);
    let object = Bytes::from(some.encode().unwrap());
    let head = Head::parse(&object).unwrap();
    let opening = head.opening(&object[HEAD_BYTES..head.parts_start() as usize]).unwrap();
    assert_eq!(
        (opening.parts.tables.len(), opening.parts.in_table(0), opening.parts.in_table(1)),
        (2, 256, 1)
    );
    assert_eq!(Contents::decode(&object).unwrap(), some);
    for version in [5, 7] {
        let mut other = object.to_vec();
        other[8] = version;
        assert!(Contents::decode(&other.into()).is_err(), "version {version}");
    }
    for wrong in [parts(256 * 256 + 1, 256), parts(0, 0), parts(u32::MAX, 1)] {
        assert!(wrong.encode().is_err() || Contents::decode(&wrong.encode().unwrap().into()).is_err());
    }
    let longer = Contents { part_directory: vec![Bytes::new(); 2], ..parts(1, 1) };
    assert!(longer.encode().is_err());
}

#[test]
fn animations_come_back_and_their_absence_costs_nothing() {
    let plain = contents(2);
    let opening = |object: &[u8]| {
        let head = Head::parse(object).unwrap();
        (head.opening_bytes, head.opening(&object[HEAD_BYTES..head.parts_start() as usize]).unwrap())
    };
    let animations = vec![Bytes::from_static(b"walk"), Bytes::from_static(b"door")];
    let some = Contents { animations: animations.clone(), ..plain.clone() };
    let object = Bytes::from(some.encode().unwrap());
    assert_eq!(Contents::decode(&object).unwrap(), some);
    let (length, with) = opening(&object);
    assert_eq!((with.animations.len(), with.animation_table().map(|table| table.models)), (2, Some(2)));
    let object = plain.encode().unwrap();
    let (shorter, without) = opening(&object);
    assert_eq!((without.animations.len(), without.animation_table()), (0, None));
    let listed: usize =
        1 + with.animations.iter().map(|part| crate::encoding::encode(part).unwrap().len()).sum::<usize>();
    assert_eq!(length - shorter, listed as u32);
    // An empty list is no other way to say so.
    let empty = [crate::encoding::encode(&without).unwrap(), vec![0]].concat();
    assert!(Opening::decode(&empty).is_err() && Opening::decode(&empty[..empty.len() - 1]).is_ok());
}

#[test]
fn leading_pages_with_their_base_meshes_come_before_all_else() {
    let object = contents(40).encode().unwrap();
    let head = Head::parse(&object).unwrap();
    let start = head.parts_start() as usize;
    let opening = head.opening(&object[HEAD_BYTES..start]).unwrap();
    // Ten pages of 6,000 bytes fill the first 64 KiB; lists of their packs follow, then the other pages.
    let leading = opening.pages.iter().take_while(|place| place.page.offset < 64 << 10).count();
    assert!((10..=11).contains(&leading), "{leading}");
    assert!(opening.pages[0].source.offset > opening.pages[leading - 1].page.end());
    assert!(opening.pages[leading].page.offset > opening.pages[leading - 1].source.end());
    assert!(opening.flight_bytes <= opening.pages[leading].page.offset);
}

#[test]
fn bounds_of_a_page_hold_its_instances_relative_to_the_eye() {
    let mut contents = contents(2);
    contents.header.camera.eye = [1e7, 0.0, 5.0];
    for page in &mut contents.pages {
        page.assets.iter_mut().for_each(|asset| asset.sphere.radius = 0.5);
        page.instances.iter_mut().for_each(|instance| instance.placement.translation[0] += 1e7);
    }
    let object = contents.encode().unwrap();
    let head = Head::parse(&object).unwrap();
    let opening = head.opening(&object[HEAD_BYTES..head.parts_start() as usize]).unwrap();
    let place = &opening.pages[1];
    let reach = (glam::Vec3::from(place.center) - glam::Vec3::new(10.0, 0.0, -5.0)).length();
    assert!(place.radius >= reach + 0.5 && place.radius < reach + 0.51, "{place:?}");
}

#[test]
fn records_that_contradict_their_page_are_refused() {
    let contents = contents(1);
    let object = contents.encode().unwrap();
    let head = Head::parse(&object).unwrap();
    let (opening, body) = object[HEAD_BYTES..].split_at(head.opening_bytes as usize);
    let opening = head.opening(opening).unwrap();
    let place = &opening.pages[0];
    let bytes = |part: &Part| body[part.offset as usize..part.end() as usize].to_vec();
    let rest = body.len() as u64;
    let page = bytes(&place.page);
    assert!(PageRecord::decode_checked(&page, 1, &place.page, rest).is_err(), "another number");
    assert!(PageRecord::decode_checked(&page, 0, &place.page, 6000).is_err(), "base meshes beyond the end");
    let record = PageRecord::decode_checked(&page, 0, &place.page, rest).unwrap();
    let source = bytes(&place.source);
    let decode = |page: &ScenePage, rest| SourceRecord::decode_checked(&source, page, &place.source, rest);
    assert!(decode(&record.page, rest).is_ok());
    assert!(decode(&record.page, rest - 1).is_err(), "index pages beyond the end");
    let mut other = record.page.clone();
    other.assets[0].chunk_count = 64;
    assert!(decode(&other, rest).is_err(), "other index pages than chunks need");
    other.assets.pop();
    assert!(decode(&other, rest).is_err(), "fewer packs than assets");
}

#[test]
fn chunks_lie_one_behind_the_other_in_segments() {
    let chunks = vec![
        ChunkPlace { bytes: 10, cut: 0, first: [0; 4], last: [1; 4] },
        ChunkPlace { bytes: 20, cut: 5, first: [2; 4], last: [3; 4] },
    ];
    let table = ChunkTable { offset: 100, chunks };
    let (start, chunk) = table.chunk(1).unwrap();
    let segments: Vec<_> = chunk.segments().collect();
    assert_eq!(start, 110);
    assert_eq!(segments, [(0, 5, [2; 4]), (5, 20, [3; 4])]);
    assert_eq!((table.chunk(2), table.end()), (None, 130));
    assert_eq!(chunk.hashed(&[7; 19]), None, "another length");
    let hashed = chunk.hashed(&[7; 20]).unwrap();
    assert_eq!((hashed.first, hashed.last), (segment_hash(&[7; 5]), segment_hash(&[7; 15])));
}
