//! Tables of parts come back as they were written, and others are refused.

use super::*;
use crate::encoding;

fn record(name: &str, path: &str, extras: &str) -> PartInfo {
    let extras = Some(extras.to_owned()).filter(|extras| !extras.is_empty());
    PartInfo { name: name.into(), path: path.into(), extras, ..PartInfo::default() }
}

fn some() -> Vec<PartInfo> {
    vec![
        record("door 1", "site/building 2/floor 3", r#"{"id":7,"material":"oak"}"#),
        record("door 2", "site/building 2/floor 3", r#"{"id":8,"material":"oak"}"#),
        record("", "", ""),
        // The first byte of both letters is the same.
        record("ä", "site/ä", ""),
        record("ö", "site/ö/floor", "[1,2]"),
    ]
}

#[test]
fn records_come_back_one_by_one() {
    let records = some();
    let page = encode_page(&records).unwrap();
    for (number, record) in (0..).zip(&records) {
        assert_eq!(decode_record(&page, 5, number).unwrap().as_ref(), Some(record));
    }
    assert_eq!(decode_record(&page, 5, 5), Ok(None));
}

#[test]
fn names_and_paths_that_repeat_take_few_bytes() {
    let name = |n: u32| record(&format!("window {n:03}"), "site/building 2/floor 3/facade", "");
    let page = encode_page(&(0..256).map(name).collect::<Vec<_>>()).unwrap();
    assert!(page.len() <= 60 + 256 * 9, "{} bytes", page.len());
}

/// Windows in a row far from the origin, one of them turned, and a part without a placement.
fn placed() -> Vec<PartInfo> {
    let at = |n: u32| Placement::at([408_201.25 + 0.5 * f64::from(n), 17.0, 4_080_928.5]);
    let mut records: Vec<PartInfo> = (0..40)
        .map(|n| PartInfo { in_file: at(n), ..record(&format!("window {n}"), "facade", "") })
        .collect();
    records[7].in_file.rotation = [0.0, 0.6, 0.0, 0.8];
    records[9].in_file.scale = 0.25;
    records.push(record("all", "", ""));
    records
}

#[test]
fn placements_in_the_file_come_back_exactly_and_take_few_bytes() {
    let records = placed();
    let page = encode_page(&records).unwrap();
    for (number, record) in (0..).zip(&records) {
        assert_eq!(decode_record(&page, 41, number).unwrap().as_ref(), Some(record));
    }
    let texts: Vec<_> =
        records.iter().map(|r| PartInfo { in_file: Placement::default(), ..r.clone() }).collect();
    let texts = encode_page(&texts).unwrap();
    assert_eq!(texts[0], 1, "pages without placements have no place for them");
    assert!(page.len() - texts.len() <= 41 * 7, "{} bytes more", page.len() - texts.len());
    for end in 0..page.len() {
        assert!(check_page(&page[..end], 41).is_err(), "{end} bytes");
    }
    assert!(check_page(&page, 40).is_err() && check_page(&page, 42).is_err());
}

#[test]
fn placements_that_are_not_finite_or_have_no_size_are_refused() {
    let encoded =
        |placement: Placement| encode_page(&[PartInfo { in_file: placement, ..record("a", "", "") }]);
    let whole = Placement::at([1.0; 3]);
    let bad = [
        Placement::at([f64::NAN; 3]),
        Placement { rotation: [f32::INFINITY, 0.0, 0.0, 1.0], ..whole },
        Placement { scale: 0.0, ..whole },
        Placement { scale: f32::NAN, ..whole },
    ];
    for placement in bad {
        assert_eq!(encoded(placement), Err(PartsError::Placement));
        let mut page = vec![2];
        crate::instances::encode(&[crate::instances::Instance { asset: 0, placement }], &mut page).unwrap();
        page.extend([0; 6]);
        assert_eq!(check_page(&page, 1), Err(PartsError::Placement));
    }
    let mut other = vec![2];
    crate::instances::encode(&[crate::instances::Instance::at(3, [1.0; 3])], &mut other).unwrap();
    assert_eq!(check_page(&[&other[..], &[0; 6]].concat(), 1), Err(PartsError::Placement));
}

#[test]
fn pages_that_are_cut_or_followed_by_bytes_are_refused() {
    let page = encode_page(&some()).unwrap();
    for end in 0..page.len() {
        assert!(check_page(&page[..end], 5).is_err(), "{end} bytes");
    }
    assert!(check_page(&[&page[..], &[0]].concat(), 5).is_err());
    for count in [0, 4, 6, 257, u32::MAX] {
        assert!(check_page(&page, count).is_err(), "{count} records");
    }
}

#[test]
fn hostile_pages_are_refused() {
    let page = |bytes: &[u8]| check_page(&[&[1], bytes].concat(), 1);
    assert_eq!(check_page(&[3, 0, 0, 0, 0, 0, 0], 1), Err(PartsError::Version(3)));
    assert_eq!(page(&[1, 0, 0, 0, 0, 0]), Err(PartsError::Shared("name")));
    assert_eq!(page(&[0, 1, 0xff, 0, 0, 0, 0]), Err(PartsError::Malformed(CodingError::Utf8)));
    assert_eq!(
        page(&[0, 0, 0, 0, 0, 252, 0xff, 0xff, 0xff, 0xff]),
        Err(PartsError::TextTooLong { field: "extras", bytes: u32::MAX as usize, limit: MAX_EXTRAS_BYTES })
    );
    // Two records, of which the second repeats half a character of the first.
    let half = [&[1, 0, 2][..], "ä".as_bytes(), &[0, 0, 0, 0, 1, 0, 0, 0, 0, 0]].concat();
    assert_eq!(check_page(&half, 2), Err(PartsError::Shared("name")));
}

#[test]
fn texts_that_are_too_long_are_refused() {
    let long = |n: usize| "x".repeat(n);
    assert!(encode_page(&[record(&long(255), &long(1024), &long(4096))]).is_ok());
    for [name, path, extras] in [[256, 0, 0], [0, 1025, 0], [0, 0, 4097]] {
        assert!(encode_page(&[record(&long(name), &long(path), &long(extras))]).is_err());
    }
    let most = vec![record(&long(255), &long(1024), &long(4096)), record(&"y".repeat(255), "", "")];
    assert!(encode_page(&most).unwrap().len() <= MAX_PAGE_BYTES);
}

#[test]
fn a_directory_gives_each_instance_its_records() {
    // A batch, two instances that share a record, and what follows.
    let records = [0..300, 300..301, 300..301, 301..302, 302..303, 5..7];
    let page = encode_directory(&records).unwrap();
    let runs = decode_directory(&page, 6, 303).unwrap();
    assert_eq!(runs.len(), 4, "{runs:?}");
    for (number, of) in (0..).zip(&records) {
        assert_eq!(records_of(&runs, number).as_ref(), Some(of));
    }
    assert_eq!(records_of(&runs, 6), None);
    let alike: Vec<_> = (0..1024).map(|n| n..n + 1).collect();
    assert_eq!(encode_directory(&alike).unwrap().len(), 6);
    // The most runs that a page can have.
    let apart: Vec<_> = (0..1024).map(|n| n * 7 % 1024..n * 7 % 1024 + 1).collect();
    let runs = decode_directory(&encode_directory(&apart).unwrap(), 1024, 1024).unwrap();
    assert_eq!((runs.len(), records_of(&runs, 1023)), (1024, Some(apart[1023].clone())));
}

#[test]
fn hostile_directories_are_refused() {
    let encoded = |runs: &[[u32; 3]]| {
        let run = |&[instances, parts, first]: &[u32; 3]| PartRun { instances, parts, first };
        encoding::encode(&runs.iter().map(run).collect::<Vec<_>>()).unwrap()
    };
    assert!(decode_directory(&encoded(&[[2, 3, 4]]), 2, 10).is_ok());
    for (runs, instances) in [
        (&[[2, 3, 5]][..], 2),
        (&[[0, 3, 0]], 0),
        (&[[2, 0, 0]], 2),
        (&[[2, 3, u32::MAX]], 2),
        (&[[u32::MAX, u32::MAX, 0]], u32::MAX),
        (&[[2, 1, 0]], 3),
        (&[[2, 1, 0], [2, 1, 0]], 3),
        (&[[u32::MAX, 1, 0]], 3),
    ] {
        assert!(decode_directory(&encoded(runs), instances, 10).is_err(), "{runs:?}");
    }
    assert!(encode_directory(&[]).is_err() && encode_directory(&[0..1, 3..3]).is_err());
    assert!(encode_directory(&vec![0..1; 1025]).is_err());
    let page = encode_directory(&[0..2, 4..5]).unwrap();
    (0..page.len()).for_each(|end| assert!(decode_directory(&page[..end], 2, 10).is_err(), "{end} bytes"));
}

#[test]
fn pages_are_as_many_as_their_records_need() {
    let table = |records| PartTable { records };
    assert_eq!([1, 256, 257].map(|n| table(n).pages()), [1, 1, 2]);
    assert_eq!([0, 1, 2, u32::MAX].map(|page| table(257).on_page(page)), [256, 1, 0, 0]);
    assert_eq!([0, 1, 1024, 1025].map(PartTable::directory_pages), [0, 1, 1, 2]);
    assert_eq!([0, 1, 2].map(|page| PartTable::on_directory_page(1025, page)), [1024, 1, 0]);
    assert!(table(1).check().is_ok() && table(0).check().is_err() && table(MAX_RECORDS + 1).check().is_err());
}
