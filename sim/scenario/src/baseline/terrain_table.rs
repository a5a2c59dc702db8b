//! The older system's Tables 5.2 and 5.3: least, mean and greatest time of many generations of a patch, with and
//! without a valley, and the bytes of a patch and its valley on the wire; beside them a diamond-square of the same run
//! ([`diamond_square`]).
//!
//! A generation computes the patch's heights from scratch; with a valley it also applies the valley's height overrides.
//! Each generation is at another place of the world. The three kinds alternate, so that load on the machine affects all
//! alike.

use std::fmt;
use std::hint::black_box;

use anyhow::Context as _;
use lodestream_geometry::random::Random;
use lodestream_terrain::{
    HeightOverride, HeightOverrides, Mode, PARAMETERS_BYTES, Parameters, Scratch, Shape, Stamp, Terrain,
    encode_points, encode_stamps,
};
use serde::Serialize;

use super::diamond_square::diamond_square;
use super::mesh_text::gzip_bytes;
use crate::stopwatch::{Spread, paired_ratio, rounded, timed};

/// Generations of each size in the older system's tables.
pub const GENERATIONS: u32 = 1000;
/// Levels of its sizes, and its least, mean and greatest times in milliseconds: JavaScript on a laptop of 2012.
const OLDER_MS: [(u8, [f64; 3]); 4] =
    [(7, [9.0, 9.6, 44.0]), (8, [36.0, 38.5, 79.0]), (9, [142.0, 149.7, 182.0]), (10, [564.0, 591.7, 698.0])];
/// Approximate bytes that it sent for a patch of 257² points with a valley: parameters, JSON, and JSON on the wire.
const OLDER_BYTES: [u64; 3] = [80, 38_000, 10_000];

/// Depth of the valley and distance between two of its heights, in height units.
const DEPTH: i32 = 3840;
const STEP: i32 = 16;

/// What is generated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// A patch of this project.
    Ours,
    /// The patch with the valley's height overrides.
    Valley,
    /// Diamond-square.
    Plain,
}

/// Times of one kind and size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Times {
    /// What is generated.
    pub kind: Kind,
    /// Points along a side.
    pub side: usize,
    /// Points.
    pub points: usize,
    /// Number of generations.
    pub generations: u32,
    /// Least, mean and greatest time.
    #[serde(flatten)]
    pub spread: Spread,
    /// Mean time per point, in nanoseconds.
    pub ns_per_point: f64,
    /// Time relative to diamond-square: the median over consecutive pairs.
    pub over_plain: f64,
    /// Working memory of a thread, including one patch's heights.
    pub memory_bytes: usize,
    /// The older system's least time, in milliseconds.
    pub older_min_ms: f64,
    /// Its mean.
    pub older_mean_ms: f64,
    /// Its greatest.
    pub older_max_ms: f64,
}

/// Bytes on the wire.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Size {
    /// What it is.
    pub what: &'static str,
    /// Approximate bytes in the older system; `None` if it has no counterpart.
    pub older_bytes: Option<u64>,
    /// In this project.
    pub bytes: u64,
}

/// The table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TerrainTable {
    /// Times by size and kind.
    pub times: Vec<Times>,
    /// Bytes.
    pub bytes: Vec<Size>,
}

/// Generates each size `generations` times, at least once.
///
/// # Errors
/// None for these patches.
pub fn terrain_table(generations: u32) -> anyhow::Result<TerrainTable> {
    let mut times = Vec::new();
    for (level, older_ms) in OLDER_MS {
        times.extend(times_of(level, generations, older_ms).with_context(|| format!("level {level}"))?);
    }
    Ok(TerrainTable { times, bytes: bytes()? })
}

/// Parameters of the measured terrain, in patches of (2^level + 1)² points.
#[must_use]
pub fn parameters(level: u8) -> Parameters {
    Parameters { seed: 1, finest_level: level, extent_log2: 10, ..Parameters::default() }
}

/// Column and row of the `i`th patch; consecutive patches are never adjacent.
#[must_use]
pub fn place(i: i64) -> (i64, i64) {
    (i * 7 % 1000 - 500, i * 13 % 900 - 450)
}

fn times_of(
    level: u8,
    generations: u32,
    [older_min_ms, older_mean_ms, older_max_ms]: [f64; 3],
) -> anyhow::Result<[Times; 3]> {
    let mut terrain = Terrain::new(parameters(level))?;
    let valley = valley(level)?;
    let mut buffers = [(Scratch::new(), Vec::new()), (Scratch::new(), Vec::new())];
    let (mut random, mut plain) = (Random::new(1), Vec::new());
    let mut seconds: [Vec<f64>; 3] = Default::default();
    // The first generation of each kind allocates its memory.
    for i in -1..i64::from(generations.max(1)) {
        let (x, y) = place(i);
        let [(scratch, heights), (valley_scratch, valley_heights)] = &mut buffers;
        let (made, ours) = timed(|| terrain.patch_into(x, y, level, scratch, heights));
        made?;
        black_box(&heights);
        let points = valley.clone();
        let (made, with_valley) = timed(|| {
            terrain.set_points(x, y, points)?;
            terrain.patch_into(x, y, level, valley_scratch, valley_heights)
        });
        made?;
        black_box(&valley_heights);
        terrain.remove_points(x, y);
        let ((), plainly) = timed(|| diamond_square(level, &mut random, &mut plain));
        black_box(&plain);
        if i >= 0 {
            for (all, one) in seconds.iter_mut().zip([ours, with_valley, plainly]) {
                all.push(one);
            }
        }
    }
    let memory = |(scratch, heights): &(Scratch, Vec<i32>)| scratch.bytes() + heights.capacity() * 4;
    let memory_bytes = [memory(&buffers[0]), memory(&buffers[1]), plain.capacity() * 4];
    let side = (1_usize << level) + 1;
    let points = side * side;
    Ok([Kind::Ours, Kind::Valley, Kind::Plain].map(|kind| {
        let number = kind as usize;
        let spread = Spread::of(&seconds[number]);
        Times {
            kind,
            side,
            points,
            generations: generations.max(1),
            spread,
            ns_per_point: rounded(spread.mean_ms * 1e6 / points as f64, 2),
            over_plain: rounded(paired_ratio(&seconds[number], &seconds[Kind::Plain as usize]), 3),
            memory_bytes: memory_bytes[number],
            older_min_ms,
            older_mean_ms,
            older_max_ms,
        }
    }))
}

/// A winding valley of 4,129 points through a patch, from border to border; 4,129 is a sixteenth of 257².
///
/// # Errors
/// A level without a size in the older system's tables.
pub fn valley(level: u8) -> anyhow::Result<HeightOverrides> {
    anyhow::ensure!(
        (7..=10).contains(&level),
        "there is no valley of 4,129 points at level {level}: 7 to 10"
    );
    let side = (1_u16 << level) + 1;
    let width = 4096 >> level;
    // As many rows are one point wider as the total of 4,129 requires.
    let wider = 33 - width;
    let scale = f64::from(side) / 257.0;
    let mut points = Vec::new();
    for y in 0..side {
        let width = if y < wider { width + 1 } else { width };
        let turn = f64::from(y) / f64::from(side) * std::f64::consts::TAU;
        let centre = scale * (128.0 + 50.0 * (turn * 1.25).sin() + 9.0 * (turn * 4.0).cos());
        let first = (centre - f64::from(width) / 2.0).round() as u16;
        for x in first..first + width {
            let across = (f64::from(x) - centre) / (f64::from(width) / 2.0 + 1.0);
            let depth = f64::from(DEPTH) * (0.5 + 0.5 * (across * std::f64::consts::PI).cos());
            let height = -(depth / f64::from(STEP)).round() as i32 * STEP;
            points.push(HeightOverride { x, y, mode: Mode::Additive, height });
        }
    }
    Ok(HeightOverrides::new(level, points)?)
}

fn bytes() -> anyhow::Result<Vec<Size>> {
    let level = 8;
    let valley = valley(level)?;
    let points: Vec<_> = valley.as_slice().iter().map(|p| (p.x, p.y, p.height)).collect();
    let json = serde_json::to_vec(&serde_json::json!({ "mode": "additive", "points": points }))?;
    let [parameters, as_json, as_sent] = OLDER_BYTES.map(Some);
    // A point of the winding line every 17 rows.
    let bends = [0, 40, 50, 20, -20, -40, -50, -10];
    let line = (0..16_i64).map(|i| [128 + bends[i as usize % bends.len()], i * 17]).collect();
    let stamp = |shape| encode_stamps(&[Stamp { mode: Mode::Additive, shape }]);
    let winding = stamp(Shape::RiverBed { line, half_width: 9, depth: DEPTH })?;
    let straight = stamp(Shape::Valley { from: [100, 0], to: [150, 257], half_width: 9, depth: DEPTH })?;
    let size = |what, older_bytes, bytes: usize| Size { what, older_bytes, bytes: bytes as u64 };
    Ok(vec![
        size("parameters", parameters, PARAMETERS_BYTES),
        size("the valley's points as JSON", as_json, json.len()),
        Size { what: "the same through gzip", older_bytes: as_sent, bytes: gzip_bytes(&json)? },
        size("the same, coded as here", None, encode_points(level, &valley)?.len()),
        size("a winding valley as a stamp", None, winding.len()),
        size("a straight one", None, straight.len()),
    ])
}

impl fmt::Display for TerrainTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "| patch | what | ms: least / mean / greatest | ns a point | over plain | older system, ms |"
        )?;
        write!(f, "|---|---|---|---|---|---|")?;
        for times in &self.times {
            let Spread { min_ms, mean_ms, max_ms } = times.spread;
            let what = match times.kind {
                Kind::Ours => "ours",
                Kind::Valley => "ours with a valley",
                Kind::Plain => "plain",
            };
            write!(
                f,
                "\n| {}² | {what} | {min_ms:.3} / {mean_ms:.3} / {max_ms:.3} | {:.2} | {:.2} | {} / {} / {} |",
                times.side,
                times.ns_per_point,
                times.over_plain,
                times.older_min_ms,
                times.older_mean_ms,
                times.older_max_ms
            )?;
        }
        write!(f, "\n\n| what | older, bytes | bytes |\n|---|---|---|")?;
        for size in &self.bytes {
            let older = size.older_bytes.map_or("–".to_owned(), |bytes| bytes.to_string());
            write!(f, "\n| {} | {older} | {} |", size.what, size.bytes)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_valley_has_4129_points_and_goes_from_border_to_border() {
        for level in 7..=10 {
            let valley = valley(level).unwrap();
            let points = valley.as_slice();
            assert_eq!(points.len(), 4129, "level {level}");
            let side = 1_u16 << level;
            assert!(
                points.iter().all(|p| p.x <= side && p.height < 0 && p.height >= -DEPTH),
                "level {level}"
            );
            assert!((0..=side).all(|row| points.iter().any(|p| p.y == row)), "level {level}");
        }
        assert!(valley(6).is_err() && valley(11).is_err());
    }

    /// A generation with a valley contains the valley.
    #[test]
    fn a_valley_lowers_each_of_its_points_by_its_depth() {
        let mut terrain = Terrain::new(parameters(7)).unwrap();
        let (x, y) = place(0);
        let before = terrain.patch(x, y, 7).unwrap();
        let valley = valley(7).unwrap();
        terrain.set_points(x, y, valley.clone()).unwrap();
        let after = terrain.patch(x, y, 7).unwrap();
        for point in valley.as_slice() {
            let at = usize::from(point.y) * 129 + usize::from(point.x);
            assert_eq!(after[at] - before[at], point.height, "{point:?}");
        }
    }

    #[test]
    fn each_size_has_three_kinds_in_order_and_a_valley_is_short() {
        let table = terrain_table(2).unwrap();
        let sides: Vec<usize> = table.times.iter().map(|times| times.side).collect();
        assert_eq!(sides, [129, 129, 129, 257, 257, 257, 513, 513, 513, 1025, 1025, 1025]);
        for times in &table.times {
            let Spread { min_ms, mean_ms, max_ms } = times.spread;
            assert!(min_ms > 0.0 && min_ms <= mean_ms && mean_ms <= max_ms, "{times:?}");
            assert_eq!((times.points, times.generations), (times.side * times.side, 2));
            assert!((4 * times.points..64 * times.points).contains(&times.memory_bytes), "{times:?}");
            assert!(times.kind != Kind::Plain || times.over_plain == 1.0, "{times:?}");
        }
        let bytes: Vec<u64> = table.bytes.iter().map(|size| size.bytes).collect();
        let [parameters, json, gzip, sent, winding, straight] = bytes[..] else { panic!("{bytes:?}") };
        assert!(parameters <= 32 && winding <= 100 && straight <= 20, "{bytes:?}");
        assert!(sent <= 2048 && sent < gzip && gzip < json / 2, "{bytes:?}");
        // Two heads, and a line for each figure.
        assert_eq!(table.to_string().lines().count(), 2 + 12 + 1 + 2 + 6);
    }
}
