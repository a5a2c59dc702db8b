//! The same input gives the same bytes: from run to run, on any number of threads, in any order.

use lodestream_geometry::base::Base;
use lodestream_geometry::check::check;
use lodestream_geometry::index::decode_page;
use lodestream_geometry::pool::{Serial, Silent};
use lodestream_geometry::prepare::{Hooks, prepare};

use crate::common::{Shuffled, all, prepared, quantised, regions};

#[test]
fn bytes_do_not_depend_on_threads_or_on_the_order_of_tasks() {
    for (name, source) in all() {
        let settings = regions(200);
        let expected = prepared(&quantised(&source), &settings);
        for (threads, seed) in [(1, 1), (2, 2), (5, 3)] {
            // Quantised anew: hash maps are seeded anew as well.
            let mesh = quantised(&source);
            let again = prepare(&mesh, &settings, &Hooks::new(&Shuffled { threads, seed }, &Silent)).unwrap();
            assert!(
                again.base.encode().unwrap() == expected.base.encode().unwrap(),
                "{name}: base, {threads} threads"
            );
            assert!(again.pages == expected.pages, "{name}: index, {threads} threads");
            assert!(again.chunks == expected.chunks, "{name}: chunks, {threads} threads");
        }
    }
}

#[test]
fn what_a_client_decodes_is_what_was_prepared() {
    for (name, source) in all() {
        let asset = prepared(&quantised(&source), &regions(200));
        assert!(Base::decode(&asset.base.encode().unwrap()).unwrap() == asset.base, "{name}: base");
        let mut infos = Vec::new();
        for page in &asset.pages {
            infos.extend(decode_page(page, infos.len() as u32).unwrap());
        }
        assert!(infos == asset.infos, "{name}: index");
    }
}

#[test]
fn a_check_does_not_depend_on_threads() {
    let asset = prepared(&quantised(&all()[3].1), &regions(50));
    let on = |pool| check(&asset.base, &asset.infos, &asset.chunks, 12, 5, pool).unwrap();
    assert_eq!(on(&Serial), on(&Shuffled { threads: 3, seed: 8 }));
}
