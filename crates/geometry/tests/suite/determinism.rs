//! The same input gives the same bytes: in every run, on any number of threads, in any task order.

use lodestream_geometry::base::Base;
use lodestream_geometry::check::check;
use lodestream_geometry::index::decode_page;
use lodestream_geometry::pool::{Pool, Serial, Silent};
use lodestream_geometry::prepare::{Hooks, prepare};

use crate::common::{Shuffled, all, in_blocks, prepared, quantised, regions, shapes};

#[test]
fn bytes_do_not_depend_on_threads_or_on_the_order_of_tasks() {
    for (name, source) in all() {
        let plain = regions(200);
        let runs = [(5, 3, plain), (3, 4, in_blocks(500, regions(100)))];
        for (threads, seed, settings) in runs {
            let expected = prepared(&quantised(&source), &settings);
            // Quantised again, because hash maps are seeded differently each time.
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

/// The last level has one region, which is searched on all threads for vertices to lock.
#[test]
fn one_region_of_many_samples_is_the_same_on_any_number_of_threads() {
    let mesh = quantised(&shapes::sphere(96, 100, 0.3));
    let expected = prepared(&mesh, &regions(500));
    for threads in [2, 5] {
        let pool = Shuffled { threads, seed: 9 };
        let again = prepare(&mesh, &regions(500), &Hooks::new(&pool, &Silent)).unwrap();
        assert_eq!(again, expected);
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

/// A faulty pool that leaves out one of several tasks.
struct SkippingPool;

impl Pool for SkippingPool {
    fn run(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        (0..count).filter(|&i| count < 2 || i != count / 2).for_each(task);
    }
}

#[test]
fn a_pool_that_skips_a_task_is_an_error_and_no_other_asset() {
    let mesh = quantised(&shapes::torus(30, 40));
    let result = prepare(&mesh, &regions(200), &Hooks::new(&SkippingPool, &Silent));
    assert!(result.is_err_and(|e| e.to_string().contains("left out task")));
}
