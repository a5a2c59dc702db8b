//! Times variants of the generation of terrain patches, and its scaling over threads and patches visited.
//!
//! `cargo bench -p lodestream-sim --bench terrain`. Sizes, and diamond-square for comparison, are in `lodestream-sim
//! terrain-table`. Variants alternate with the uniform one, so that load on the machine affects both: ratios hold,
//! times do not.

mod heap;

use std::hint::black_box;

use lodestream_scenario::baseline::terrain_table::{parameters, place};
use lodestream_scenario::stopwatch::{median, paired_ratio, timed};
use lodestream_terrain::{
    Distribution, Erosion, FeatureSet, Mode, Parameters, Scratch, Shape, Stamp, Terrain, TerrainError,
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
    println!("\nrough places: how many, ms to measure them, median of nine");
    measured("ten stamps", &ten_stamps())?;
    measured("the most there are", &crossing_beds())?;
    println!("\npatches visited, 257 x 257, one after another: s in all, most heap in use in KiB");
    for patches in [1, 10, 100, 1000, 10_000] {
        visited(patches)?;
    }
    Ok(())
}

/// Ridges around a valley with a river of twelve segments, a crater and a plateau.
fn ten_stamps() -> Vec<Stamp> {
    let ridge = |from, to, half_width| Shape::Ridge { from, to, half_width, height: 15_000 };
    let mut shapes = vec![
        ridge([-1250, -2600], [-800, -700], 800),
        ridge([-820, -760], [-1150, 1500], 620),
        ridge([700, -2500], [980, -300], 760),
        ridge([960, -340], [800, 1300], 560),
        ridge([-2600, -2500], [200, -3300], 1300),
        ridge([150, -3250], [2400, -2600], 1200),
        Shape::Crater { centre: [560, 700], radius: 120, depth: 3000, rim: 1200 },
    ];
    shapes.push(Shape::Valley { from: [-60, -1700], to: [40, 2600], half_width: 620, depth: 3500 });
    let line = (0..13).map(|k| [k * 37 % 90 - 150, k * 240 - 560]).collect();
    shapes.push(Shape::RiverBed { line, half_width: 44, depth: 4200 });
    shapes.push(Shape::Plateau { centre: [0, 14], radius: 44, falloff: 90, height: -3404 });
    shapes.into_iter().map(|shape| Stamp { mode: Mode::Fixed, shape }).collect()
}

/// Pairs of crossing river beds of fifteen segments each.
fn crossing_beds() -> Vec<Stamp> {
    let bed = |i: i64| {
        let line = (0..16).map(|k| [i / 2 * 8000 + k * 60 - 450, i % 2 * 50 + k * 37 % 90]).collect();
        Stamp { mode: Mode::Fixed, shape: Shape::RiverBed { line, half_width: 300, depth: 4000 } }
    };
    (0..4).map(bed).collect()
}

fn measured(name: &str, stamps: &[Stamp]) -> Result<(), TerrainError> {
    let parameters = Parameters { finest_level: 10, extent_log2: 6, amplitude: 7000, ..parameters(8) };
    let terrain = Terrain::with_stamps(parameters, stamps.to_vec())?;
    let times: Vec<f64> = (0..9).map(|_| timed(|| black_box(terrain.rough_places())).1).collect();
    println!("{name:<22} {:3} {:8.1}", terrain.rough_places().len(), median(times) * 1e3);
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
