//! Times the generation of terrain patches against a plain diamond-square in f32, in one run.
//!
//! `cargo bench -p lodestream-sim --bench terrain`. The plain one has no features, its borders agree with
//! nothing, its heights depend on the order of points, and its random numbers come from a sequence. Both make a
//! patch in turn, so that the ratios hold on a busy machine; times do not.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::hint::black_box;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use lodestream_geometry::random::Random;
use lodestream_geometry::terrain::{
    Distribution, Erosion, FeatureSet, Mode, Parameters, Point, Scratch, Shape, Terrain, TerrainError,
};

/// Patches of a row of the table.
const PATCHES: i64 = 1000;

fn main() -> Result<(), TerrainError> {
    println!(
        "{PATCHES} patches each, made in turn: ms min / mean / max; ns per point of the mean; median of paired ratios"
    );
    for level in 7..=10 {
        sizes(level)?;
    }
    println!(
        "\nvariants, 257 x 257, 300 patches each in turn with the uniform one: median ns per point, median of paired ratios"
    );
    variants()?;
    println!("\ntwo threads");
    for level in [8, 10] {
        parallel(level)?;
    }
    println!("\npatches visited, 257 x 257, one after another: s in all, most heap in use in KiB");
    for patches in [1, 10, 100, 1000, 10_000] {
        visited(patches)?;
    }
    Ok(())
}

fn parameters(level: u8) -> Parameters {
    Parameters { seed: 1, finest_level: level, extent_log2: 10, ..Parameters::default() }
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn place(i: i64) -> (i64, i64) {
    (i * 7 % 1000 - 500, i * 13 % 900 - 450)
}

fn sizes(level: u8) -> Result<(), TerrainError> {
    let terrain = Terrain::new(parameters(level))?;
    let points = f64::from((1 << level) + 1).powi(2);
    let (mut scratch, mut heights, mut plain) = (Scratch::new(), Vec::new(), Vec::new());
    let mut random = Random::new(1);
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    // The first of each fills its memory.
    for i in -1..PATCHES {
        let (x, y) = place(i);
        let (made, seconds) = timed(|| terrain.patch_into(x, y, level, &mut scratch, &mut heights));
        made?;
        black_box(&heights);
        let ((), plain_seconds) = timed(|| diamond_square(level, &mut random, &mut plain));
        black_box(&plain);
        if i >= 0 {
            ours.push(seconds);
            theirs.push(plain_seconds);
        }
    }
    let statistics = |times: &[f64]| {
        let mean = times.iter().sum::<f64>() / times.len() as f64;
        let least = times.iter().copied().fold(f64::INFINITY, f64::min);
        let most = times.iter().copied().fold(0.0, f64::max);
        let ns = mean / points * 1e9;
        format!("{:7.3} / {:7.3} / {:7.3} ms {ns:5.2} ns", least * 1e3, mean * 1e3, most * 1e3)
    };
    let ratio = median(ours.iter().zip(&theirs).map(|(a, b)| a / b).collect());
    let side = (1 << level) + 1;
    let bytes = (scratch.bytes() + heights.capacity() * 4) as f64 / 1024.0;
    println!(
        "{side:>5}²  ours {}  plain {}  ratio {ratio:.2}  memory {bytes:.0} KiB, {:.1} bytes a point",
        statistics(&ours),
        statistics(&theirs),
        bytes * 1024.0 / points
    );
    Ok(())
}

/// The plain algorithm, in place: centres, then edges, of one step after another.
fn diamond_square(level: u8, random: &mut Random, heights: &mut Vec<f32>) {
    let side = (1_usize << level) + 1;
    heights.clear();
    heights.resize(side * side, 0.0);
    let mut range = 65_536.0_f32;
    let mut offset = |range: f32| ((random.next_u64() >> 40) as f32 * (2.0 / (1 << 24) as f32) - 1.0) * range;
    for corner in [0, side - 1, side * (side - 1), side * side - 1] {
        heights[corner] = offset(range);
    }
    let mut step = side - 1;
    while step > 1 {
        let half = step / 2;
        range *= 0.5;
        for y in (half..side).step_by(step) {
            for x in (half..side).step_by(step) {
                let at = |x: usize, y: usize| heights[y * side + x];
                let sum = at(x - half, y - half)
                    + at(x + half, y - half)
                    + at(x - half, y + half)
                    + at(x + half, y + half);
                heights[y * side + x] = sum * 0.25 + offset(range);
            }
        }
        for y in (0..side).step_by(half) {
            let first = if (y / half).is_multiple_of(2) { half } else { 0 };
            for x in (first..side).step_by(step) {
                let at = y * side + x;
                heights[at] = offset(range)
                    + if x == 0 || y == 0 || x == side - 1 || y == side - 1 {
                        let beside = [(x >= half, at.wrapping_sub(half)), (x + half < side, at + half)];
                        let beyond =
                            [(y >= half, at.wrapping_sub(half * side)), (y + half < side, at + half * side)];
                        let inside = beside.into_iter().chain(beyond).filter(|n| n.0);
                        inside.map(|n| heights[n.1]).sum::<f32>() / 3.0
                    } else {
                        let sum = heights[at - half]
                            + heights[at + half]
                            + heights[at - half * side]
                            + heights[at + half * side];
                        sum * 0.25
                    };
            }
        }
        step = half;
    }
}

fn variants() -> Result<(), TerrainError> {
    let plain = Terrain::new(parameters(8))?;
    let gaussian = Parameters { distribution: Distribution::Gaussian, ..parameters(8) };
    let eroded = |passes, spike_limit| Parameters {
        erosion: Erosion { level: 8, passes, talus: 128, spike_limit },
        ..parameters(8)
    };
    // A valley through every patch, 16 points wide, listed and as a stamp.
    let (x, y) = (40, 50);
    let points =
        (0..257 * 16).map(|i| Point { x: x * 256 + 120 + i % 16, y: y * 256 + i / 16, height: -900 });
    let listed = FeatureSet { mode: Mode::Additive, points: points.collect(), stamps: Vec::new() };
    let shape = Shape::Valley {
        from: [x * 256 + 128, y * 256],
        to: [x * 256 + 128, y * 256 + 256],
        half_width: 9,
        depth: 900,
    };
    let stamped = FeatureSet { mode: Mode::Additive, points: Vec::new(), stamps: vec![shape] };
    for (name, terrain) in [
        ("uniform", plain.clone()),
        ("Gaussian", Terrain::new(gaussian)?),
        ("4,112 listed points", Terrain::with_features(parameters(8), &[listed])?),
        ("a valley as a stamp", Terrain::with_features(parameters(8), &[stamped])?),
        ("spike removal", Terrain::new(eroded(0, 16))?),
        ("8 passes of erosion", Terrain::new(eroded(8, 0))?),
        ("32 passes of erosion", Terrain::new(eroded(32, 0))?),
    ] {
        let (mut scratch, mut heights) = (Scratch::new(), Vec::new());
        let (mut times, mut ratios) = (Vec::new(), Vec::new());
        for _ in 0..300 {
            let (made, seconds) = timed(|| terrain.patch_into(x, y, 8, &mut scratch, &mut heights));
            made?;
            black_box(&heights);
            let (made, base) = timed(|| plain.patch_into(x, y, 8, &mut scratch, &mut heights));
            made?;
            black_box(&heights);
            times.push(seconds / (257.0 * 257.0) * 1e9);
            ratios.push(seconds / base);
        }
        println!("{name:<22} {:6.2} ns  {:5.2} x", median(times), median(ratios));
    }
    let mut scratch = Scratch::new();
    let (heights, seconds) = timed(|| {
        (0..100_000)
            .map(|i| plain.height_at(i * 37 % 90_000, i * 91 % 70_000, &mut scratch))
            .collect::<Result<Vec<_>, _>>()
    });
    black_box(heights?);
    println!("{:<22} {:6.2} ns each", "one height", seconds * 1e4);
    let ((), seconds) = timed(|| {
        black_box(plain.level_errors());
    });
    println!("{:<22} {:6.2} ms", "errors of all levels", seconds * 1e3);
    Ok(())
}

fn parallel(level: u8) -> Result<(), TerrainError> {
    let terrain = Terrain::new(parameters(level))?;
    let patches = if level == 8 { 2000 } else { 200 };
    let make = |first: i64, step: usize| {
        let (mut scratch, mut heights) = (Scratch::new(), Vec::new());
        for i in (first..patches).step_by(step) {
            let (x, y) = place(i);
            if terrain.patch_into(x, y, level, &mut scratch, &mut heights).is_err() {
                return;
            }
            black_box(&heights);
        }
    };
    let mut ratios = Vec::new();
    for _ in 0..7 {
        let ((), alone) = timed(|| make(0, 1));
        let ((), together) = timed(|| {
            std::thread::scope(|scope| {
                scope.spawn(|| make(0, 2));
                scope.spawn(|| make(1, 2));
            });
        });
        ratios.push(alone / together);
    }
    let best = ratios.iter().copied().fold(0.0, f64::max);
    println!(
        "{:>5}²  {:.2} x as fast as one (median of 7; best {best:.2})",
        (1 << level) + 1,
        median(ratios)
    );
    Ok(())
}

fn visited(patches: i64) -> Result<(), TerrainError> {
    let before = USED.load(Ordering::Relaxed);
    PEAK.store(before, Ordering::Relaxed);
    let (result, seconds) = timed(|| {
        let terrain = Terrain::new(parameters(8))?;
        let (mut scratch, mut heights) = (Scratch::new(), Vec::new());
        for i in 0..patches {
            let (x, y) = place(i);
            terrain.patch_into(x, y, 8, &mut scratch, &mut heights)?;
            black_box(&heights);
        }
        Ok(())
    });
    let most = (PEAK.load(Ordering::Relaxed) - before) as f64 / 1024.0;
    println!("{patches:>6}  {seconds:8.3} s  {most:.0} KiB");
    result
}

/// Bytes in use, and the most since the last reset.
static USED: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

/// The system's allocator, counting.
struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

// SAFETY: everything is handed to the system's allocator as it came; the counters are beside it.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps `alloc`'s contract.
        let pointer = unsafe { System.alloc(layout) };
        if !pointer.is_null() {
            let used = USED.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
            PEAK.fetch_max(used, Ordering::Relaxed);
        }
        pointer
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        USED.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller keeps `dealloc`'s contract.
        unsafe { System.dealloc(pointer, layout) }
    }
}
