//! `scene.toml`: parsed strictly, then resolved. Every error names file, line and remedy.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use crate::preparation_settings::{Batching, Precision, PreparationSettings, Round};
use crate::sources::Sources;
use lodestream_geometry::UnknownName;
use lodestream_import::{InvalidValue, Part, gltf};
use lodestream_scene::description::Camera;
use lodestream_scene::limits::MAX_NAME_BYTES;
use lodestream_scene::placement::Placement;
use serde::Deserialize;
use toml::Spanned;

use super::model::{Asset, DEFAULT_FOV_Y_DEGREES, Scene, unit};
use super::names::UniqueNames;
use super::punctual_light::RawPunctualLight;
use super::surroundings;
use super::terrain::{RawTerrain, SceneTerrain};

/// Largest scene file, in bytes.
const MAX_SCENE_BYTES: u64 = 256 << 20;

/// A scene that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// No file at all.
    #[error("no scene: name models (OBJ, glTF, GLB, PLY, STL) or one scene.toml")]
    NothingNamed,
    /// A scene file beside other files.
    #[error("{}: a scene file stands alone; list its models in it as [[asset]]", path.display())]
    SceneAmongOthers {
        /// The scene file.
        path: PathBuf,
    },
    /// The file cannot be read.
    #[error(transparent)]
    Read(#[from] lodestream_import::ImportError),
    /// An error at a line of the file.
    #[error("{}:{line}: {what}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Fault and remedy.
        what: String,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawScene {
    name: Option<Spanned<String>>,
    proxies: Option<bool>,
    #[serde(default)]
    asset: Vec<Spanned<RawAsset>>,
    instance: Option<Vec<Spanned<RawInstance>>>,
    surroundings: Option<Spanned<String>>,
    light: Option<Spanned<RawLight>>,
    ambient: Option<Spanned<RawColor>>,
    background: Option<Spanned<RawColor>>,
    camera: Option<Spanned<RawCamera>>,
    terrain: Option<Spanned<RawTerrain>>,
    #[serde(default)]
    punctual_light: Vec<Spanned<RawPunctualLight>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawAsset {
    name: String,
    file: PathBuf,
    mesh: Option<String>,
    #[serde(default)]
    merge: bool,
    position_bits: Option<u8>,
    tolerance: Option<f64>,
    uv_bits: Option<u8>,
    normal_tolerance: Option<f64>,
    crease_angle: Option<f64>,
    metric: Option<String>,
    round_size: Option<RawRound>,
    codec: Option<String>,
    block_faces: Option<usize>,
    relief_depth: Option<f32>,
    texture_quality: Option<u8>,
    effort: Option<String>,
    batch: Option<RawBatch>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected \"auto\", \"off\" or a number of faces")]
enum RawBatch {
    Word(String),
    Faces(usize),
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected \"heap\" or a share of the vertices")]
enum RawRound {
    Word(String),
    Share(f64),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawInstance {
    asset: Spanned<String>,
    #[serde(default)]
    translation: [f64; 3],
    rotation: Option<RawRotation>,
    scale: Option<f32>,
    /// Whether the second coordinate of `translation` is relative to the terrain.
    #[serde(default)]
    on_terrain: bool,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected [x, y, z, w] or { yaw = …, pitch = …, roll = … } in degrees")]
enum RawRotation {
    Quaternion([f64; 4]),
    Angles(Angles),
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Angles {
    yaw: f64,
    pitch: f64,
    roll: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawLight {
    direction: Option<[f32; 3]>,
    color: Option<[f32; 3]>,
    intensity: Option<f32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawColor {
    color: Option<[f32; 3]>,
    intensity: Option<f32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawCamera {
    eye: [f64; 3],
    target: [f64; 3],
    up: Option<[f32; 3]>,
    fov_y_degrees: Option<f32>,
}

/// Reads a scene file. Its models' paths are relative to it.
///
/// # Errors
/// See [`SceneError`].
pub fn read(path: &Path) -> Result<Scene, SceneError> {
    read_with(path, &PreparationSettings::default(), &Sources::default())
}

/// As [`read`], with settings that take precedence over the file's.
pub(super) fn read_with(
    path: &Path,
    flags: &PreparationSettings,
    sources: &Sources,
) -> Result<Scene, SceneError> {
    let bytes = lodestream_import::read_file(path, MAX_SCENE_BYTES)?;
    let text = std::str::from_utf8(&bytes).map_err(|error| {
        let line = 1 + bytes[..error.valid_up_to()].iter().filter(|&&b| b == b'\n').count();
        SceneError::Line { path: path.to_owned(), line, what: "is not UTF-8 text".to_owned() }
    })?;
    parse_with(path, text, flags, sources)
}

/// Parses the text of a scene file at `path`.
///
/// # Errors
/// See [`SceneError`].
pub fn parse(path: &Path, text: &str) -> Result<Scene, SceneError> {
    parse_with(path, text, &PreparationSettings::default(), &Sources::default())
}

fn parse_with(
    path: &Path,
    text: &str,
    flags: &PreparationSettings,
    sources: &Sources,
) -> Result<Scene, SceneError> {
    let source = Source { path, text };
    let raw: RawScene = toml::from_str(text).map_err(|error| {
        // A likely mistake with a misleading message: TOML cannot have a table and a list of one name.
        if let Some((at, _)) =
            text.match_indices("[[light]]").find(|(at, _)| *at == 0 || text[..*at].ends_with('\n'))
        {
            return source.error(
                at,
                "[light] is the only directional light; write [[punctual_light]] for point and spot lights",
            );
        }
        let message = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
        source.error(error.span().map_or(0, |span| span.start), message)
    })?;
    source.resolve(raw, flags, sources)
}

struct Source<'a> {
    path: &'a Path,
    text: &'a str,
}

impl Source<'_> {
    fn error(&self, offset: usize, what: impl Into<String>) -> SceneError {
        let before = self.text.as_bytes().get(..offset).unwrap_or_default();
        let line = 1 + before.iter().filter(|&&b| b == b'\n').count();
        SceneError::Line { path: self.path.to_owned(), line, what: what.into() }
    }

    fn resolve(
        &self,
        raw: RawScene,
        flags: &PreparationSettings,
        sources: &Sources,
    ) -> Result<Scene, SceneError> {
        let mut scene = Scene::empty();
        if let Some(name) = raw.name {
            self.check_name("the scene", name.get_ref(), name.span().start)?;
            scene.name = name.into_inner();
        } else if let Some(stem) = self.path.file_stem() {
            scene.name = stem.to_string_lossy().into_owned();
        }
        if raw.asset.is_empty() && raw.terrain.is_none() {
            return Err(self.error(0, "has no [[asset]] and no [terrain]; add one with name and file"));
        }
        let folder = self.path.parent().unwrap_or(Path::new(""));
        scene.files.push(self.path.to_owned());
        if let Some(terrain) = raw.terrain {
            scene.files.extend(terrain.get_ref().features_file(folder));
            scene.terrain = Some(self.terrain(folder, terrain)?);
        }
        let mut numbers = BTreeMap::new();
        // Names in the scene file take precedence over the names of meshes in its models.
        let mut names = UniqueNames::default();
        raw.asset.iter().for_each(|asset| names.reserve(asset.get_ref().name.as_str()));
        for raw in raw.asset {
            let at = raw.span().start;
            let (asset, merge) = self.asset(folder, raw)?;
            if numbers.insert(asset.name.clone(), scene.models.len()).is_some() {
                return Err(self.error(at, format!("asset {:?} is defined twice; rename one", asset.name)));
            }
            if merge {
                scene.add_merged(asset, sources)?
            } else {
                scene.add_model(asset, flags, sources, &mut names)?
            };
        }
        if let Some(instances) = raw.instance {
            let mut placed = Vec::with_capacity(instances.len());
            for raw in instances {
                let (model, place) = self.instance(&numbers, raw, scene.terrain.as_ref())?;
                let count = scene.models[model].parts.len() as u32;
                scene.instance_parts.extend((0..count).map(|part| (model as u32, part)));
                let (parts, punctual_lights) = scene.models[model].placed(place);
                placed.extend(parts);
                scene.punctual_lights.extend(punctual_lights);
            }
            scene.instances = Some(placed);
        }
        for raw in raw.punctual_light {
            let at = raw.span().start;
            let punctual_light = raw.into_inner().resolve(scene.terrain.as_ref());
            scene
                .punctual_lights
                .extend(punctual_light.map_err(|why| self.error(at, format!("punctual light: {why}")))?);
        }
        if let Some(surroundings) = &raw.surroundings {
            let colored = raw.ambient.is_some() || raw.background.is_some();
            surroundings::set(&mut scene, surroundings.get_ref(), colored)
                .map_err(|why| self.error(surroundings.span().start, why))?;
        }
        self.lights(&mut scene, raw.light, raw.ambient, raw.background)?;
        scene.proxies = raw.proxies.unwrap_or(true);
        scene.camera = raw.camera.map(|raw| self.camera(raw)).transpose()?;
        Ok(scene)
    }

    fn check_name(&self, of: &str, name: &str, at: usize) -> Result<(), SceneError> {
        if name.is_empty() || name.len() > MAX_NAME_BYTES {
            return Err(self.error(
                at,
                format!("{of} has a name of {} bytes; 1 to {MAX_NAME_BYTES} are allowed", name.len()),
            ));
        }
        Ok(())
    }

    /// The asset, and whether the meshes of its file are merged into one.
    fn asset(&self, folder: &Path, raw: Spanned<RawAsset>) -> Result<(Asset, bool), SceneError> {
        let at = raw.span().start;
        let raw = raw.into_inner();
        self.check_name("the asset", &raw.name, at)?;
        let error = |what: &str| self.error(at, format!("asset {:?}: {what}", raw.name));
        if raw.position_bits.is_some() && raw.tolerance.is_some() {
            return Err(error("position_bits and tolerance exclude each other; keep one"));
        }
        let bad = |field: &'static str| {
            let error = &error;
            move |why: InvalidValue| error(&format!("{field}: {why}"))
        };
        let bits = setting(raw.position_bits).map_err(bad("position_bits"))?;
        let tolerance = setting(raw.tolerance).map_err(bad("tolerance"))?;
        let round = raw.round_size.as_ref().map(|round| match round {
            RawRound::Word(word) => word.parse(),
            RawRound::Share(share) => Round::try_from(*share),
        });
        let batching = raw.batch.as_ref().map(|batch| match batch {
            RawBatch::Word(word) => word.parse(),
            RawBatch::Faces(faces) => Batching::try_from(*faces),
        });
        if batching.is_some() && (raw.merge || raw.mesh.is_some()) {
            return Err(error(
                "batch is for assets of several meshes: leave it out, or leave out mesh and merge",
            ));
        }
        let preparation_settings = PreparationSettings {
            precision: bits.map(Precision::Bits).or(tolerance.map(Precision::Tolerance)),
            uv_bits: setting(raw.uv_bits).map_err(bad("uv_bits"))?,
            normal_tolerance: setting(raw.normal_tolerance).map_err(bad("normal_tolerance"))?,
            crease_angle: setting(raw.crease_angle).map_err(bad("crease_angle"))?,
            metric: choice(raw.metric.as_deref()).map_err(bad("metric"))?,
            round: round.transpose().map_err(bad("round_size"))?,
            codec: choice(raw.codec.as_deref()).map_err(bad("codec"))?,
            block_faces: setting(raw.block_faces).map_err(bad("block_faces"))?,
            relief_depth: setting(raw.relief_depth).map_err(bad("relief_depth"))?,
            texture_quality: setting(raw.texture_quality).map_err(bad("texture_quality"))?,
            effort: choice(raw.effort.as_deref()).map_err(bad("effort"))?,
            batching: batching.transpose().map_err(bad("batch"))?,
            // A setting of the scene, not of a model.
            proxies: None,
        };
        let file = folder.join(&raw.file);
        let part = match &raw.mesh {
            Some(_) if raw.merge => return Err(error("mesh and merge exclude each other; keep one")),
            Some(name) => gltf::part_named(&file, name)?,
            None => Part::Whole,
        };
        Ok((Asset { name: raw.name, file, part, preparation_settings }, raw.merge))
    }

    /// The number of the placed model, and its placement.
    fn instance(
        &self,
        numbers: &BTreeMap<String, usize>,
        raw: Spanned<RawInstance>,
        terrain: Option<&SceneTerrain>,
    ) -> Result<(usize, Placement), SceneError> {
        let at = raw.span().start;
        let raw = raw.into_inner();
        let Some(&model) = numbers.get(raw.asset.get_ref()) else {
            let (at, name) = (raw.asset.span().start, raw.asset.get_ref());
            let known: Vec<&str> = numbers.keys().take(5).map(String::as_str).collect();
            return Err(
                self.error(at, format!("no asset is named {name:?}; there are: {}", known.join(", ")))
            );
        };
        if !raw.translation.iter().all(|x| x.is_finite()) {
            return Err(self.error(at, "translation must be three finite numbers"));
        }
        let scale = raw.scale.unwrap_or(1.0);
        if !(scale.is_finite() && scale > 0.0) {
            return Err(self.error(at, "scale must be a positive number"));
        }
        let rotation = match raw.rotation {
            None => [0.0, 0.0, 0.0, 1.0],
            Some(RawRotation::Quaternion(q)) => normalised(q),
            Some(RawRotation::Angles(angles)) => normalised(quaternion(&angles)),
        };
        if !rotation.iter().all(|x| x.is_finite()) {
            return Err(self.error(at, "rotation must be a quaternion other than zero, or finite angles"));
        }
        let mut translation = raw.translation;
        if raw.on_terrain {
            let [x, _, z] = translation;
            let Some(terrain) = terrain else {
                return Err(self.error(at, "on_terrain needs a [terrain]; add one, or leave on_terrain out"));
            };
            let Some(ground) = terrain.height(x, z) else {
                return Err(
                    self.error(at, format!("there is no terrain at {x}, {z}; more patches reach further"))
                );
            };
            translation[1] += ground;
        }
        Ok((model, Placement { translation, rotation, scale }))
    }

    fn terrain(&self, folder: &Path, raw: Spanned<RawTerrain>) -> Result<SceneTerrain, SceneError> {
        let at = raw.span().start;
        let raw = raw.into_inner();
        let features = match raw.features_file(folder) {
            Some(file) => lodestream_import::terrain::features::read(&file)
                .map_err(|why| self.error(at, format!("terrain: {why}")))?,
            None => Vec::new(),
        };
        raw.resolve(features).map_err(|why| self.error(at, format!("terrain: {why}")))
    }

    fn lights(
        &self,
        scene: &mut Scene,
        light: Option<Spanned<RawLight>>,
        ambient: Option<Spanned<RawColor>>,
        background: Option<Spanned<RawColor>>,
    ) -> Result<(), SceneError> {
        if let Some(light) = light {
            let at = light.span().start;
            let light = light.into_inner();
            if let Some(direction) = light.direction {
                scene.light_direction = unit(direction)
                    .ok_or_else(|| self.error(at, "the light's direction must be finite and not zero"))?;
            }
            let color = RawColor { color: light.color, intensity: light.intensity };
            scene.light_color = self.color(at, &color, scene.light_color)?;
        }
        if let Some(ambient) = ambient {
            scene.ambient = self.color(ambient.span().start, ambient.get_ref(), [1.0; 3])?;
        }
        if let Some(background) = background {
            scene.background = self.color(background.span().start, background.get_ref(), scene.background)?;
        }
        Ok(())
    }

    fn color(&self, at: usize, raw: &RawColor, default: [f32; 3]) -> Result<[f32; 3], SceneError> {
        let intensity = raw.intensity.unwrap_or(1.0);
        let color = raw.color.unwrap_or(default).map(|x| x * intensity);
        if color.iter().all(|x| x.is_finite() && *x >= 0.0) {
            return Ok(color);
        }
        Err(self.error(at, "color and intensity must be finite and not negative"))
    }

    fn camera(&self, raw: Spanned<RawCamera>) -> Result<Camera, SceneError> {
        let at = raw.span().start;
        let raw = raw.into_inner();
        let fov_y_degrees = raw.fov_y_degrees.unwrap_or(DEFAULT_FOV_Y_DEGREES);
        if !(0.1..=175.0).contains(&fov_y_degrees) {
            return Err(self.error(at, "fov_y_degrees must be 0.1 to 175"));
        }
        if !raw.eye.iter().chain(&raw.target).all(|x| x.is_finite()) || raw.eye == raw.target {
            return Err(self.error(at, "eye and target must be two different finite points"));
        }
        let up = raw.up.unwrap_or([0.0, 1.0, 0.0]);
        let up = unit(up).ok_or_else(|| self.error(at, "up must be finite and not zero"))?;
        Ok(Camera { eye: raw.eye, target: raw.target, up, fov_y: fov_y_degrees.to_radians() })
    }
}

/// Converts an optional number to its setting.
fn setting<Number, Setting: TryFrom<Number, Error = InvalidValue>>(
    number: Option<Number>,
) -> Result<Option<Setting>, InvalidValue> {
    number.map(Setting::try_from).transpose()
}

/// Parses an optional word as a named choice.
fn choice<Choice: FromStr<Err = UnknownName>>(word: Option<&str>) -> Result<Option<Choice>, InvalidValue> {
    Ok(word.map(str::parse).transpose()?)
}

/// Yaw about +y, then pitch about the turned x, then roll about the turned z, in degrees.
fn quaternion(angles: &Angles) -> [f64; 4] {
    let half = |degrees: f64| (degrees.to_radians() / 2.0).sin_cos();
    let ((sy, cy), (sx, cx), (sz, cz)) = (half(angles.yaw), half(angles.pitch), half(angles.roll));
    // q = q_y · q_x · q_z
    [
        cy * sx * cz + sy * cx * sz,
        sy * cx * cz - cy * sx * sz,
        cy * cx * sz - sy * sx * cz,
        cy * cx * cz + sy * sx * sz,
    ]
}

fn normalised(q: [f64; 4]) -> [f32; 4] {
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    q.map(|x| (x / length) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FULL: &str = r#"
name = "court"
[[asset]]
name = "column"
file = "column.obj"
position_bits = 12
[[asset]]
name = "wall"
file = "sub/wall.obj"
tolerance = 0.001
relief_depth = 0.04
[[instance]]
asset = "column"
translation = [1.0, 2, 1e7]
rotation = { yaw = 90 }
scale = 2
[[instance]]
asset = "wall"
rotation = [0, 0, 0, 2]
[light]
direction = [0, 2, 0]
color = [1, 0.5, 0.25]
intensity = 2
[ambient]
intensity = 0.5
[background]
color = [0, 0, 0]
[camera]
eye = [0, 1, 5]
target = [0, 1, 0]
fov_y_degrees = 60
"#;

    #[test]
    fn everything_is_read() {
        let scene = parse(Path::new("dir/scene.toml"), FULL).unwrap();
        assert_eq!(scene.name, "court");
        assert_eq!(scene.assets[0].file, Path::new("dir/column.obj"));
        assert_eq!(scene.assets[0].preparation_settings.precision, "12".parse().ok().map(Precision::Bits));
        assert_eq!(
            scene.assets[1].preparation_settings.precision,
            "0.001".parse().ok().map(Precision::Tolerance)
        );
        assert_eq!(scene.assets[1].preparation_settings.relief_depth, "0.04".parse().ok());
        let instances = scene.instances.unwrap();
        assert_eq!(instances[0].placement.translation, [1.0, 2.0, 1e7]);
        let [x, y, z, w] = instances[0].placement.rotation;
        let half = std::f32::consts::FRAC_1_SQRT_2;
        assert!((y - half).abs() < 1e-6 && (w - half).abs() < 1e-6 && x == 0.0 && z == 0.0);
        assert_eq!(instances[0].placement.scale, 2.0);
        assert_eq!(instances[1].placement.rotation, [0.0, 0.0, 0.0, 1.0]);
        assert_eq!(scene.light_direction, [0.0, 1.0, 0.0]);
        assert_eq!(scene.light_color, [2.0, 1.0, 0.5]);
        assert_eq!(scene.ambient, [0.5; 3]);
        assert_eq!(scene.camera.unwrap().fov_y, 60_f32.to_radians());
    }

    #[test]
    fn angles_turn_in_the_stated_order() {
        let turn = |yaw, pitch, roll, v: glam::DVec3| {
            let [x, y, z, w] = quaternion(&Angles { yaw, pitch, roll });
            glam::DQuat::from_xyzw(x, y, z, w) * v
        };
        let expected = glam::DQuat::from_rotation_y(0.3)
            * glam::DQuat::from_rotation_x(0.5)
            * glam::DQuat::from_rotation_z(0.7)
            * glam::DVec3::new(1.0, 2.0, 3.0);
        let found = turn(
            0.3f64.to_degrees(),
            0.5f64.to_degrees(),
            0.7f64.to_degrees(),
            glam::DVec3::new(1.0, 2.0, 3.0),
        );
        assert!((found - expected).length() < 1e-12, "{found} {expected}");
    }

    #[test]
    fn errors_name_file_and_line_and_what_to_do() {
        let cases: [(&str, &str, &[&str]); 13] = [
            ("name = \"court\"", "nmae = \"court\"", &[":2:", "nmae"]),
            ("position_bits = 12", "position_bits = 25", &[":3:", "\"column\"", "4 to 24"]),
            ("position_bits = 12", "position_bits = \"x\"", &[":6:", "u8"]),
            ("position_bits = 12", "position_bits = 12\ntolerance = 1", &["exclude each other"]),
            ("tolerance = 0.001", "tolerance = -1", &["positive length"]),
            ("name = \"wall\"", "name = \"column\"", &[":7:", "defined twice"]),
            ("asset = \"wall\"", "asset = \"wal\"", &["no asset is named \"wal\"", "column, wall"]),
            ("scale = 2", "scale = 0", &["scale must be"]),
            ("scale = 2", "scale = ", &[":16:"]),
            ("rotation = [0, 0, 0, 2]", "rotation = [0, 0, 0, 0]", &["quaternion other than zero"]),
            ("rotation = [0, 0, 0, 2]", "rotation = 7", &["[x, y, z, w]"]),
            ("eye = [0, 1, 5]", "eye = [0, 1, 0]", &["two different"]),
            ("color = [0, 0, 0]", "color = [0, nan, 0]", &["finite"]),
        ];
        for (from, to, fragments) in cases {
            let message = parse(Path::new("s.toml"), &FULL.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(message.starts_with("s.toml:") && !message.contains('\n'), "{message}");
            for fragment in fragments {
                assert!(message.contains(fragment), "{message:?} lacks {fragment:?}");
            }
        }
        let message = parse(Path::new("s.toml"), "name = 'x'").unwrap_err().to_string();
        assert!(message.contains("no [[asset]]"), "{message}");
    }

    #[test]
    fn models_become_a_scene_and_a_scene_stands_alone() {
        let files = ["a/x.obj", "b/x.obj", "y.OBJ"].map(PathBuf::from);
        let scene = super::super::of_files(&files).unwrap();
        let names: Vec<&str> = scene.assets.iter().map(|a| a.name.as_str()).collect();
        assert_eq!(names, ["x", "x-2", "y"]);
        assert_eq!(scene.instances, None);
        let mixed = ["a.obj", "s.toml"].map(PathBuf::from);
        assert!(super::super::of_files(&mixed).unwrap_err().to_string().contains("stands alone"));
        assert!(super::super::of_files(&[]).is_err());
        let missing = super::super::of_files(&[PathBuf::from("/no/s.toml")]).unwrap_err().to_string();
        assert!(missing.contains("/no/s.toml: cannot be read"), "{missing}");
    }
}
