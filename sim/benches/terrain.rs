//! Times variants of the generation of terrain patches, and its scaling over threads and patches visited.
//!
//! `cargo bench -p lodestream-sim --bench terrain`. Sizes, and the plain diamond-square that they are held against, are
//! in `lodestream-sim terrain-table`. Variants are made in turn with the uniform one, so that the ratios hold on a busy
//! machine; times do not.

mod heap;

use std::hint::black_box;

use lodestream_scenario::baseline::terrain_table::{parameters, place};
use lodestream_scenario::stopwatch::{median, paired_ratio, timed};
use lodestream_terrain::{
    Distribution, Erosion, FeatureSet, Mode, Parameters, Scratch, Shape, Terrain, TerrainError,
};

fn main() -> Result<(), TerrainError> {
    println!(
        "variants, 257 x 257, 300 patches each in turn with the uniform one: median ns per point, median of paired ratios"
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

fn variants() -> Result<(), TerrainError> {
    let plain = Terrain::new(parameters(8))?;
    let gaussian = Parameters { distribution: Distribution::Gaussian, ..parameters(8) };
    let eroded = |passes, spike_limit| Parameters {
        erosion: Erosion { level: 8, passes, talus: 128, spike_limit },
        ..parameters(8)
    };
    let (x, y) = (40, 50);
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
        ("a valley as a stamp", Terrain::with_features(parameters(8), &[stamped])?),
        ("spike removal", Terrain::new(eroded(0, 16))?),
        ("8 passes of erosion", Terrain::new(eroded(8, 0))?),
        ("32 passes of erosion", Terrain::new(eroded(32, 0))?),
    ] {
        let (mut scratch, mut heights) = (Scratch::new(), Vec::new());
        let (mut times, mut base) = (Vec::new(), Vec::new());
        for _ in 0..300 {
            let (made, seconds) = timed(|| terrain.patch_into(x, y, 8, &mut scratch, &mut heights));
            made?;
            black_box(&heights);
            let (made, plainly) = timed(|| plain.patch_into(x, y, 8, &mut scratch, &mut heights));
            made?;
            black_box(&heights);
            times.push(seconds);
            base.push(plainly);
        }
        let ratio = paired_ratio(&times, &base);
        println!("{name:<22} {:6.2} ns  {ratio:5.2} x", median(times) / (257.0 * 257.0) * 1e9);
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
    let before = heap::used();
    heap::take_peak();
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
    let most = (heap::take_peak() - before) as f64 / 1024.0;
    println!("{patches:>6}  {seconds:8.3} s  {most:.0} KiB");
    result
}
