//! Terrains whose heights are recorded as hashes, for comparison between machines: `examples/golden.rs` prints them.

use lodestream_terrain::{
    Distribution, Erosion, FeatureSet, Mode, Parameters, Point, Scratch, Shape, Terrain, TerrainError,
    fingerprint,
};

/// Name and hash of the heights of each case.
pub(crate) fn hashes() -> Result<Vec<(&'static str, u64)>, TerrainError> {
    let plain = Parameters { extent_log2: 10, amplitude: 100_000, ..Parameters::default() };
    let gaussian = Parameters { distribution: Distribution::Gaussian, seed: 7, ..plain };
    let rough =
        Parameters { seed: u64::MAX, roughness: 22_000, base: -70_000, amplitude: 1_000_000, ..plain };
    let largest = Parameters { finest_level: 12, extent_log2: 19, amplitude: 178_000_000, ..plain };
    let smallest = Parameters { finest_level: 1, extent_log2: 30, ..plain };
    let erosion = Erosion { level: 6, passes: 12, talus: 200, spike_limit: 6 };
    let eroded = Parameters { seed: 11, erosion, ..plain };
    let featured = Terrain::with_features(gaussian, &features())?;
    let weathered = Terrain::with_features(eroded, &features())?;
    let [plain, gaussian, rough, largest, smallest] =
        [plain, gaussian, rough, largest, smallest].map(Terrain::new);
    let (plain, gaussian, largest, smallest) = (plain?, gaussian?, largest?, smallest?);
    let mut scratch = Scratch::new();
    let mut heights = Vec::new();
    let mut hash = |terrain: &Terrain, level: i8, x: i64, y: i64, width: usize, height: usize| {
        terrain.window(level, x, y, width, height, &mut scratch, &mut heights)?;
        Ok::<u64, TerrainError>(fingerprint(&heights))
    };
    // Worlds of 2^32 points along each axis: more than `usize` holds on a 32-bit machine.
    let errors = |terrain: &Terrain| {
        let errors: Vec<i32> = terrain.level_errors().into_iter().map(u32::cast_signed).collect();
        fingerprint(&errors)
    };
    Ok(vec![
        ("patch 0,0", hash(&plain, 8, 0, 0, 257, 257)?),
        ("patch -3,5", hash(&plain, 8, -3 * 256, 5 * 256, 257, 257)?),
        ("patch -3,5 at level 4", hash(&plain, 4, -3 * 16, 5 * 16, 17, 17)?),
        ("window across patches", hash(&plain, 7, -300, 55, 400, 199)?),
        ("corners of patches", hash(&plain, -4, -64, -64, 129, 129)?),
        ("gaussian", hash(&gaussian, 8, 0, 0, 257, 257)?),
        ("rough", hash(&rough?, 8, 0, 0, 257, 257)?),
        ("smallest patches, corner of the world", hash(&smallest, 1, (1 << 31) - 9, -1 << 31, 10, 10)?),
        ("largest patches, edge of the world", hash(&largest, 12, (1 << 31) - 300, -150, 301, 300)?),
        ("features", hash(&featured, 8, -257, -257, 515, 515)?),
        ("features at level 3", hash(&featured, 3, -9, -9, 18, 18)?),
        ("erosion and features", hash(&weathered, 8, -257, -257, 515, 515)?),
        ("erosion and features at level 3", hash(&weathered, 3, -9, -9, 18, 18)?),
        ("level errors", errors(&plain)),
        ("level errors of the largest world, smallest patches", errors(&smallest)),
        ("level errors of the largest world, largest patches", errors(&largest)),
    ])
}

/// One feature of each kind.
fn features() -> Vec<FeatureSet> {
    let point = |i: i64| Point { x: i * 37 % 200 - 100, y: i * i * 11 % 300 - 150, height: i as i32 * 900 };
    let stamps = vec![
        Shape::Ridge { from: [-200, -40], to: [90, 130], half_width: 30, height: 40_000 },
        Shape::Valley { from: [-100, 100], to: [120, -110], half_width: 25, depth: 50_000 },
        Shape::Crater { centre: [130, 60], radius: 33, depth: 30_000, rim: 9000 },
    ];
    let fixed = vec![
        Shape::Plateau { centre: [-120, -120], radius: 20, falloff: 35, height: 10_000 },
        Shape::RiverBed { line: vec![[-256, 7], [-90, 40], [10, -20], [256, 9]], half_width: 6, depth: 8000 },
    ];
    vec![
        FeatureSet { mode: Mode::Additive, points: (0..40).map(point).collect(), stamps },
        FeatureSet { mode: Mode::Fixed, points: (20..23).map(point).collect(), stamps: fixed },
    ]
}
