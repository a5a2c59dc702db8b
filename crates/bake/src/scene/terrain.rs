//! `[terrain]` of a scene file: lengths in world units, resolved to the integer parameters of a terrain.

use std::path::{Path, PathBuf};

use lodestream_import::InvalidValue;
use lodestream_import::terrain::{ErosionPasses, FinestLevel, Roughness, SpikeLimit, Talus, TalusSlope};
use lodestream_scene::terrain::{TerrainEntry, Water};
use lodestream_terrain::{Distribution, Erosion, FeatureSet, Mode, Parameters, Scratch, Shape, Terrain};
use serde::Deserialize;

use super::curve::curve;

/// The terrain of a scene.
#[derive(Clone, Debug)]
pub struct SceneTerrain {
    /// Its entry in the scene header.
    pub entry: TerrainEntry,
    /// The generator with all features.
    pub terrain: Terrain,
}

impl PartialEq for SceneTerrain {
    fn eq(&self, other: &Self) -> bool {
        // Heights follow from the entry and the points of patches.
        let points = |of: &Self| -> Vec<_> {
            let patches = of.terrain.patches_with_points();
            patches.map(|(x, y)| ((x, y), of.terrain.points(x, y).cloned())).collect()
        };
        self.entry == other.entry && points(self) == points(other)
    }
}

impl SceneTerrain {
    /// Height of the ground at a place, in world units: exact on the finest triangles. `None` outside the world.
    #[must_use]
    pub fn height(&self, x: f64, z: f64) -> Option<f64> {
        let (x, z) = (x / f64::from(self.entry.unit), z / f64::from(self.entry.unit));
        let edge = self.terrain.edge(self.terrain.finest_level()).ok()? as f64;
        let inside = x.abs() <= edge && z.abs() <= edge;
        let height =
            || self.terrain.height_between(x, z, &mut Scratch::new()) * f64::from(self.entry.height_unit);
        inside.then(height)
    }
}

/// The TOML table `[terrain]`. Lengths and heights are in world units.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawTerrain {
    #[serde(default)]
    seed: u64,
    /// Cells along a patch's side: a power of two from 2 to 4096.
    #[serde(default = "default_patch")]
    patch_cells: u32,
    /// Patches along the world's side: a power of two from 2.
    #[serde(default = "default_patches")]
    patches: u64,
    #[serde(default = "one")]
    unit: f32,
    #[serde(default = "centimetre")]
    height_unit: f32,
    amplitude: f64,
    #[serde(default = "half")]
    roughness: f64,
    #[serde(default)]
    base: f64,
    distribution: Option<String>,
    zones: Option<[f32; 3]>,
    water: Option<RawWater>,
    erosion: Option<RawErosion>,
    /// A file of features, as the tool `terrain` reads it: points and stamps in grid and height units.
    pub(super) features: Option<PathBuf>,
    #[serde(default)]
    stamp: Vec<RawStamp>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawWater {
    /// Height of its surface.
    level: f32,
    /// Visibility: the distance at which a tenth of green light remains.
    #[serde(default = "clear")]
    clarity: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawErosion {
    /// Level at which erosion runs; the finest if `None`.
    level: Option<u8>,
    #[serde(default)]
    passes: u8,
    /// Talus slope in degrees: up to it nothing slides.
    #[serde(default = "repose")]
    talus_degrees: f64,
    /// Most that a point may rise above its neighbours, in ranges of the level's offsets; 0 keeps spikes.
    #[serde(default)]
    spikes: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawStamp {
    kind: String,
    #[serde(default)]
    mode: RawMode,
    from: Option<[f64; 2]>,
    to: Option<[f64; 2]>,
    centre: Option<[f64; 2]>,
    line: Option<Vec<[f64; 2]>>,
    /// Whether to interpolate `line` as a smooth curve.
    #[serde(default)]
    smooth: bool,
    half_width: Option<f64>,
    radius: Option<f64>,
    falloff: Option<f64>,
    height: Option<f64>,
    depth: Option<f64>,
    rim: Option<f64>,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum RawMode {
    Fixed,
    #[default]
    Additive,
}

fn default_patch() -> u32 {
    256
}
fn default_patches() -> u64 {
    64
}
fn one() -> f32 {
    1.0
}
fn centimetre() -> f32 {
    0.01
}
fn half() -> f64 {
    0.5
}
fn clear() -> f32 {
    6.0
}
fn repose() -> f64 {
    35.0
}

/// Converts a number to its setting.
fn setting<Number, Setting: TryFrom<Number, Error = InvalidValue>>(
    name: &'static str,
    number: Number,
) -> Result<Setting, String> {
    number.try_into().map_err(refusal(name))
}

/// The error of a key's value.
fn refusal<Why: std::fmt::Display>(name: &'static str) -> impl Fn(Why) -> String {
    move |why| format!("{name}: {why}")
}

/// A number of units as an integer.
fn units<T: TryFrom<i64>>(name: &str, length: f64, unit: f32) -> Result<T, String> {
    let count = (length / f64::from(unit)).round();
    // Every f64 up to 2^53 is an integer of 64 bits.
    let whole = (count.abs() <= 9e15).then_some(count as i64).and_then(|count| T::try_from(count).ok());
    whole.ok_or_else(|| format!("{name} of {length} is out of range for units of {unit}"))
}

impl RawTerrain {
    /// Resolves the table, with the features of `[[terrain.stamp]]` and of the feature file.
    pub(super) fn resolve(self, more: Vec<FeatureSet>) -> Result<SceneTerrain, String> {
        for (name, unit) in [("unit", self.unit), ("height_unit", self.height_unit)] {
            if !(unit.is_finite() && (1e-6..=1e6).contains(&unit)) {
                return Err(format!("{name} must be a length from 1e-6 to 1e6"));
            }
        }
        let finest = FinestLevel::of_patch_cells(self.patch_cells).map_err(refusal("patch_cells"))?;
        let patches =
            self.patches.checked_ilog2().filter(|n| self.patches.is_power_of_two() && (1..=31).contains(n));
        let Some(extent_log2) = patches.and_then(|n| u8::try_from(n - 1).ok()) else {
            return Err(format!("patches must be a power of two from 2 to {}", 1_u64 << 31));
        };
        let roughness: Roughness = setting("roughness", self.roughness)?;
        let distribution = self.distribution.as_deref().map_or(Ok(Distribution::default()), str::parse);
        let amplitude: u32 = units("amplitude", self.amplitude, self.height_unit)?;
        let mut parameters = Parameters {
            seed: self.seed,
            finest_level: finest.get(),
            extent_log2,
            distribution: distribution.map_err(refusal("distribution"))?,
            amplitude,
            roughness: roughness.in_parameters(),
            base: units("base", self.base, self.height_unit)?,
            erosion: Erosion::default(),
        };
        if let Some(erosion) = &self.erosion {
            parameters.erosion = erosion.resolve(finest, amplitude, self.unit, self.height_unit)?;
        }
        parameters.check().map_err(|why| why.to_string())?;
        let (base, amplitude) = (self.base as f32, self.amplitude as f32);
        let zones =
            self.zones.unwrap_or([base - 0.4 * amplitude, base + 0.8 * amplitude, base + 1.6 * amplitude]);
        let mut sets: Vec<FeatureSet> = self
            .stamp
            .iter()
            .map(|stamp| stamp.resolve(self.unit, self.height_unit))
            .collect::<Result<_, _>>()?;
        sets.extend(more);
        let terrain = Terrain::with_features(parameters, &sets).map_err(|why| why.to_string())?;
        let entry = TerrainEntry {
            parameters,
            unit: self.unit,
            height_unit: self.height_unit,
            zones,
            stamps: terrain.stamps().to_vec(),
            patches: u32::try_from(terrain.patches_with_points().count())
                .map_err(|_| "too many patches have points")?,
            water: self.water.map(|RawWater { level, clarity }| Water { level, clarity }),
        };
        entry.check().map_err(|why| why.to_string())?;
        Ok(SceneTerrain { entry, terrain })
    }

    /// The file of features, relative to the scene file's folder.
    pub(super) fn features_file(&self, folder: &Path) -> Option<PathBuf> {
        self.features.as_ref().map(|file| folder.join(file))
    }
}

impl RawErosion {
    fn resolve(
        &self,
        finest: FinestLevel,
        amplitude: u32,
        unit: f32,
        height_unit: f32,
    ) -> Result<Erosion, String> {
        let level = self.level.unwrap_or(finest.get());
        let slope: TalusSlope = setting("talus_degrees", self.talus_degrees)?;
        let passes: ErosionPasses = setting("passes", self.passes)?;
        let spikes: SpikeLimit = setting("spikes", self.spikes)?;
        // `Parameters::check` refuses a level beyond the finest.
        let step = f64::from(unit) * f64::from(1_u32 << finest.get().saturating_sub(level));
        let rise = slope.rise(step) / f64::from(height_unit);
        Ok(Erosion {
            level,
            passes: passes.get(),
            talus: Talus::of_rise(rise, amplitude).in_parameters(),
            spike_limit: spikes.in_parameters(),
        })
    }
}

impl RawStamp {
    /// The line of a river bed.
    fn river(&self) -> Result<Vec<[f64; 2]>, String> {
        let line = self.line.clone().ok_or("a stamp of kind \"river bed\" needs line")?;
        if self.smooth { curve(&line) } else { Ok(line) }
    }

    fn resolve(&self, unit: f32, height_unit: f32) -> Result<FeatureSet, String> {
        let kind = self.kind.as_str();
        let missing = |name: &str| format!("a stamp of kind {kind:?} needs {name}");
        let position = |name: &str, p: Option<[f64; 2]>| -> Result<[i64; 2], String> {
            let [x, z] = p.ok_or_else(|| missing(name))?;
            Ok([units(name, x, unit)?, units(name, z, unit)?])
        };
        let length = |name: &str, l: Option<f64>| -> Result<u32, String> {
            units(name, l.ok_or_else(|| missing(name))?, unit)
        };
        let height = |name: &str, h: Option<f64>| -> Result<i32, String> {
            units(name, h.ok_or_else(|| missing(name))?, height_unit)
        };
        let shape = match kind {
            "ridge" => Shape::Ridge {
                from: position("from", self.from)?,
                to: position("to", self.to)?,
                half_width: length("half_width", self.half_width)?,
                height: height("height", self.height)?,
            },
            "valley" => Shape::Valley {
                from: position("from", self.from)?,
                to: position("to", self.to)?,
                half_width: length("half_width", self.half_width)?,
                depth: height("depth", self.depth)?,
            },
            "crater" => Shape::Crater {
                centre: position("centre", self.centre)?,
                radius: length("radius", self.radius)?,
                depth: height("depth", self.depth)?,
                rim: height("rim", self.rim)?,
            },
            "plateau" => Shape::Plateau {
                centre: position("centre", self.centre)?,
                radius: length("radius", self.radius)?,
                falloff: length("falloff", self.falloff)?,
                height: height("height", self.height)?,
            },
            "river bed" => Shape::RiverBed {
                line: self.river()?.iter().map(|p| position("line", Some(*p))).collect::<Result<_, _>>()?,
                half_width: length("half_width", self.half_width)?,
                depth: height("depth", self.depth)?,
            },
            other => {
                return Err(format!(
                    "stamp kind {other:?} is unknown; there are \"ridge\", \"valley\", \"crater\", \"plateau\" and \"river bed\""
                ));
            }
        };
        let mode = match self.mode {
            RawMode::Fixed => Mode::Fixed,
            RawMode::Additive => Mode::Additive,
        };
        Ok(FeatureSet { mode, points: Vec::new(), stamps: vec![shape] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resolved(keys: &str) -> Result<Parameters, String> {
        let raw: RawTerrain = toml::from_str(&format!("amplitude = 10.0\n{keys}")).unwrap();
        raw.resolve(Vec::new()).map(|terrain| terrain.entry.parameters)
    }

    /// Each by the same type as the flag of the tool `terrain`.
    #[test]
    fn values_out_of_range_are_refused_with_key_and_range() {
        for (keys, refusal) in [
            ("patch_cells = 300", "patch_cells: a power of two from 2 to 4096 is possible; 300 is not"),
            ("patches = 1", "patches must be a power of two from 2 to 2147483648"),
            (
                "roughness = 2.0",
                "roughness: 0 to below 2 times the range of the level above are possible; 2 is not",
            ),
            ("distribution = 'normal'", "distribution: uniform or gaussian is possible; \"normal\" is not"),
            ("erosion = { passes = 33 }", "passes: 0 to 32 passes are possible; 33 is not"),
            (
                "erosion = { talus_degrees = 90 }",
                "talus_degrees: 0 to below 90 degrees are possible; 90 is not",
            ),
            ("erosion = { spikes = 16 }", "spikes: 0 to below 16 ranges of offsets are possible; 16 is not"),
            (
                "erosion = { level = 9 }",
                "terrain parameter erosion level is 9, must be 0 to the finest level",
            ),
        ] {
            assert_eq!(resolved(keys), Err(refusal.to_owned()), "{keys}");
        }
    }

    #[test]
    fn keys_become_the_integers_of_the_parameters() {
        let text = "patch_cells = 64\npatches = 16\ndistribution = 'gaussian'\nroughness = 0.6\n\
                    erosion = { level = 4, passes = 32, talus_degrees = 35, spikes = 1.5 }";
        let erosion = Erosion { level: 4, passes: 32, talus: 18_356, spike_limit: 24 };
        let expected = Parameters {
            seed: 0,
            finest_level: 6,
            extent_log2: 3,
            distribution: Distribution::Gaussian,
            amplitude: 1000,
            roughness: 19_661,
            base: 0,
            erosion,
        };
        assert_eq!(resolved(text), Ok(expected));
    }

    #[test]
    fn water_stands_where_a_scene_says_so() {
        let entry = |keys: &str| {
            let raw: RawTerrain = toml::from_str(&format!("amplitude = 10.0\n{keys}")).unwrap();
            raw.resolve(Vec::new()).map(|terrain| terrain.entry.water)
        };
        assert_eq!(entry(""), Ok(None));
        assert_eq!(entry("water = { level = -4 }"), Ok(Some(Water { level: -4.0, clarity: 6.0 })));
        let muddy = entry("water = { level = 2.5, clarity = 0.5 }");
        assert_eq!(muddy, Ok(Some(Water { level: 2.5, clarity: 0.5 })));
        assert!(entry("water = { level = 0, clarity = 0 }").unwrap_err().contains("clarity"));
    }

    #[test]
    fn smooth_rivers_are_curves_through_their_positions() {
        let stamps = |keys: &str| {
            let river = "[[stamp]]\nkind = 'river bed'\nhalf_width = 8\ndepth = 3";
            let raw: RawTerrain = toml::from_str(&format!("amplitude = 10.0\n{river}\n{keys}")).unwrap();
            raw.resolve(Vec::new()).map(|terrain| terrain.entry.stamps)
        };
        let line = |stamps: &[lodestream_terrain::Stamp]| match &stamps[0].shape {
            Shape::RiverBed { line, .. } => line.clone(),
            other => panic!("{other:?}"),
        };
        let given = "line = [[0, 0], [100, 0], [100, 100]]";
        assert_eq!(line(&stamps(given).unwrap()), [[0, 0], [100, 0], [100, 100]]);
        let curved = line(&stamps(&format!("{given}\nsmooth = true")).unwrap());
        assert_eq!(curved.len(), 15);
        assert_eq!([curved[0], curved[7], curved[14]], [[0, 0], [100, 0], [100, 100]]);
        let many = (0..9).map(|i| format!("[{i}, 0]")).collect::<Vec<_>>().join(", ");
        let refused = stamps(&format!("line = [{many}]\nsmooth = true")).unwrap_err();
        assert!(refused.contains("at most 8 positions"), "{refused}");
    }
}
