//! `terrain`: one patch of a terrain, alone; `terrain-import`: a height map as features.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::Args;
use lodestream_compress::whole_file::write_atomically;
use lodestream_import::terrain::height_map::{HeightMap, MapError};
use lodestream_import::terrain::{ErosionPasses, FinestLevel, Roughness, SpikeLimit, Talus, features};
use lodestream_terrain::{Distribution, Erosion, FeatureSet, Parameters, Terrain, fingerprint};

use super::outcome::Outcome;
use super::preparation_settings::{by_name, positive};

/// Parameters of a terrain, without its levels.
#[derive(Clone, Copy, Debug, Args)]
struct TerrainArguments {
    /// Seed of the random offsets.
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
    /// Range of the offsets of patch corners, in height units.
    #[arg(long, value_name = "UNITS", default_value_t = Parameters::default().amplitude)]
    amplitude: u32,
    /// Factor on the range of offsets from one level to the next, 0 to just below 2.
    #[arg(long, value_name = "FACTOR", default_value = "0.5")]
    roughness: Roughness,
    /// Distribution of offsets: uniform, or gaussian (approximately Gaussian, with the same variance).
    #[arg(long, default_value_t = Distribution::default(), value_parser = by_name::<Distribution>())]
    distribution: Distribution,
    /// Mean height, in height units.
    #[arg(long, value_name = "UNITS", default_value_t = 0, allow_negative_numbers = true)]
    base: i32,
}

/// Thermal erosion and removal of spikes, after generation.
#[derive(Clone, Copy, Debug, Args)]
struct ErosionArguments {
    /// Passes of thermal erosion, 0 to 32.
    #[arg(long, value_name = "K", default_value = "0")]
    erosion: ErosionPasses,
    /// The level to erode [default: the finest].
    #[arg(long, value_name = "L")]
    erosion_level: Option<u8>,
    /// Height difference between neighbours at that level up to which no material moves, as a fraction of the
    /// amplitude, 0 to just below 1 [default: 1/2 per 2^L].
    #[arg(long, value_name = "FRACTION")]
    talus: Option<Talus>,
    /// Most that a point may stand out from its neighbours, in ranges of that level's offsets, to just below 16; 0
    /// keeps all spikes.
    #[arg(long, value_name = "RANGES", default_value = "0")]
    spike_limit: SpikeLimit,
}

/// Where the heights are written.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct OutputArguments {
    /// Write the heights as little-endian 32-bit integers, row by row.
    #[arg(long, value_name = "OUT.i32")]
    raw: Option<PathBuf>,
    /// Write a 16-bit grey picture; the lowest height is black. A step of grey is one height unit; if the range is
    /// larger, the highest is white.
    #[arg(long, value_name = "OUT.png")]
    png: Option<PathBuf>,
    /// Print the 64-bit FNV-1a hash of what --raw would write.
    #[arg(long)]
    hash: bool,
}

#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    terrain: TerrainArguments,
    /// The level: the patch has 2^N + 1 points per side.
    #[arg(long, value_name = "N")]
    level: u8,
    /// The finest level n, 1 to 12, whose grid patches and features refer to; level N has every 2^(n - N)th point
    /// of it [default: N].
    #[arg(long, value_name = "n")]
    finest: Option<FinestLevel>,
    /// The patch: it covers X * 2^n to (X + 1) * 2^n in x, and correspondingly in y.
    #[arg(long, value_name = "X,Y", value_parser = pair, allow_hyphen_values = true)]
    patch: [i64; 2],
    /// Features: {"mode": "fixed" or "additive", "points": [[x, y, height], ...], "stamps": [...]}, or a list.
    #[arg(long, value_name = "FILE.json")]
    features: Option<PathBuf>,
    #[command(flatten)]
    erosion: ErosionArguments,
    #[command(flatten)]
    output: OutputArguments,
}

#[derive(Debug, Args)]
pub(super) struct ImportArguments {
    /// The height map: a 16-bit grey PNG, one pixel per point of the finest grid.
    #[arg(value_name = "MAP.png")]
    map: PathBuf,
    /// The feature file to write; its points are fixed.
    #[arg(short, long, value_name = "FILE.json")]
    output: PathBuf,
    /// Use every Nth pixel of every Nth row. A power of two is best, with --at at multiples of it: then the points
    /// are those of a coarser level, and the points between them are interpolated.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Grid position of the first pixel.
    #[arg(long, value_name = "X,Y", default_value = "0,0", value_parser = pair, allow_hyphen_values = true)]
    at: [i64; 2],
    /// Height units per step of grey.
    #[arg(long, value_name = "UNITS", default_value_t = 1.0, value_parser = positive)]
    scale: f64,
    /// Height of black, in height units.
    #[arg(long, value_name = "UNITS", default_value_t = 0, allow_negative_numbers = true)]
    offset: i32,
    /// The finest level of the terrain for which the error is measured, 1 to 12.
    #[arg(long, value_name = "n", default_value = "8")]
    finest: FinestLevel,
    #[command(flatten)]
    terrain: TerrainArguments,
}

impl TerrainArguments {
    /// The parameters, in the largest world that this finest level allows.
    fn resolve(self, finest: FinestLevel, erosion: Erosion) -> Parameters {
        Parameters {
            seed: self.seed,
            finest_level: finest.get(),
            extent_log2: 31 - finest.get(),
            distribution: self.distribution,
            amplitude: self.amplitude,
            roughness: self.roughness.in_parameters(),
            base: self.base,
            erosion,
        }
    }
}

impl ErosionArguments {
    fn resolve(self, finest: FinestLevel) -> Erosion {
        let level = self.erosion_level.unwrap_or(finest.get());
        let erosion = Erosion {
            level,
            passes: self.erosion.get(),
            talus: self.talus.map_or_else(
                || (1_u16 << 15).checked_shr(u32::from(level)).unwrap_or(0),
                Talus::in_parameters,
            ),
            spike_limit: self.spike_limit.in_parameters(),
        };
        if erosion.is_on() { erosion } else { Erosion { level, ..Erosion::default() } }
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let finest = arguments.finest.map_or_else(|| FinestLevel::try_from(arguments.level), Ok);
    let finest = finest.context("the finest level (--finest, or else --level)")?;
    let parameters = arguments.terrain.resolve(finest, arguments.erosion.resolve(finest));
    let file = arguments.features.as_deref();
    let sets = file.map_or(Ok(Vec::new()), features::read)?;
    let terrain = with_features(parameters, &sets, file)?;
    let [x, y] = arguments.patch;
    let heights = terrain.patch(x, y, arguments.level)?;
    let (low, high) = heights.iter().fold((i32::MAX, i32::MIN), |(l, h), &v| (l.min(v), h.max(v)));
    let side = (1_usize << arguments.level) + 1;
    let hash = fingerprint(&heights);
    let wrote = |path: &Path, what: &str| {
        let name = path.display();
        Outcome::good(format!("{name}: {side} x {side} heights, {low} to {high}{what}, hash {hash:016x}\n"))
    };
    let failed = |path: &Path| format!("{}: cannot be written", path.display());
    if let Some(path) = &arguments.output.raw {
        write_atomically(path, |out| heights.iter().try_for_each(|h| out.write_all(&h.to_le_bytes())))
            .with_context(|| failed(path))?;
        return Ok(wrote(path, ""));
    }
    if let Some(path) = &arguments.output.png {
        let span = i64::from(high) - i64::from(low);
        let white = span.max(i64::from(u16::MAX));
        let grey = |&h: &i32| ((i64::from(h) - i64::from(low)) * i64::from(u16::MAX) / white) as u16;
        let picture: Vec<u8> = heights.iter().map(grey).flat_map(u16::to_ne_bytes).collect();
        write_atomically(path, |out| write_png(out, &picture, side as u32)).with_context(|| failed(path))?;
        let white = i64::from(low) + white;
        return Ok(wrote(path, &format!(" (black is {low}, white {white})")));
    }
    Ok(Outcome::good(format!("{hash:016x}\n")))
}

fn write_png(out: &mut dyn std::io::Write, grey: &[u8], side: u32) -> std::io::Result<()> {
    use image::ImageEncoder as _;
    image::codecs::png::PngEncoder::new(out)
        .write_image(grey, side, side, image::ExtendedColorType::L16)
        .map_err(std::io::Error::other)
}

fn with_features(
    parameters: Parameters,
    sets: &[FeatureSet],
    file: Option<&Path>,
) -> anyhow::Result<Terrain> {
    // Checked first, so that errors of the parameters do not name the feature file.
    parameters.check()?;
    Terrain::with_features(parameters, sets)
        .with_context(|| file.map_or_else(String::new, |file| file.display().to_string()))
}

pub(super) fn import(arguments: &ImportArguments) -> anyhow::Result<Outcome> {
    let parameters = arguments.terrain.resolve(arguments.finest, Erosion::default());
    parameters.check()?;
    let map = HeightMap::open(&arguments.map, arguments.scale, arguments.offset)?;
    let at = arguments.at;
    let set = map.features(at, arguments.every as usize, arguments.finest.get());
    let source = || arguments.map.display().to_string();
    let error = map.error(parameters, &set, at).with_context(source)?;
    let smooth = map.error(Parameters { amplitude: 0, ..parameters }, &set, at).with_context(source)?;
    write_atomically(&arguments.output, |out| features::write(out, &set))
        .with_context(|| format!("{}: cannot be written", arguments.output.display()))?;
    let told = |error: MapError| format!("max {:.0}, RMS {:.2}", error.max, error.rms);
    Ok(Outcome::good(format!(
        "{}: {} fixed points of {} x {} pixels\nerror in height units: {}; without random offsets: {}\n",
        arguments.output.display(),
        set.points.len(),
        map.width,
        map.height,
        told(error),
        told(smooth)
    )))
}

/// Parses two integers separated by a comma.
fn pair(text: &str) -> Result<[i64; 2], String> {
    let number = |part: &str| part.trim().parse::<i64>().ok();
    text.split_once(',')
        .and_then(|(x, y)| Some([number(x)?, number(y)?]))
        .ok_or_else(|| format!("{text:?} is not X,Y; write for example -3,5"))
}
