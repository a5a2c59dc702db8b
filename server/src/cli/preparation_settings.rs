//! Options of preparation, shared by `prepare`, `publish` and `serve`.

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use lodestream_bake::preparation_settings::{
    Batching, BlockFaces, CodecChoice, CreaseAngle, Effort, NormalTolerance, PositionBits, Precision,
    PreparationSettings, ReliefDepth, Round, TextureQuality, Tolerance, UvBits,
};
use lodestream_geometry::{Metric, Named};

/// Precision of positions: at most one of the two.
#[derive(Clone, Copy, Debug, Args)]
#[group(required = false, multiple = false)]
struct PrecisionArguments {
    /// Bits per axis of positions, 4 to 24. More bits cost about 3 bits a vertex each [default: 14].
    #[arg(long, value_name = "N")]
    position_bits: Option<PositionBits>,
    /// Largest error of a position, in the model's units; determines the bits.
    #[arg(long, value_name = "LENGTH")]
    tolerance: Option<Tolerance>,
}

/// Preparation settings as flags.
#[derive(Clone, Copy, Debug, Args)]
pub(super) struct PreparationArguments {
    #[command(flatten)]
    precision: PrecisionArguments,
    /// Bits per axis of texture coordinates, 1 to 16 [default: 12].
    #[arg(long, value_name = "N")]
    uv_bits: Option<UvBits>,
    /// Normals of the model are dropped where they differ by at most this angle from the normals computed from the
    /// faces: 0 keeps all, 180 none [default: 10].
    #[arg(long, value_name = "DEGREES")]
    normal_tolerance: Option<NormalTolerance>,
    /// Of models without normals, neighbouring faces at a larger angle are shaded apart, where the file does not say which
    /// are smooth [default: 40].
    #[arg(long, value_name = "DEGREES")]
    crease_angle: Option<CreaseAngle>,
    /// Cost of an edge collapse: qem (quadric error), melax (length × curvature), clustering (size of the cell that
    /// holds both ends) or clustering-seams (the same, along seams) [default: qem].
    #[arg(long, value_name = "METRIC", value_parser = by_name::<Metric>())]
    metric: Option<Metric>,
    /// Order of collapses: heap (the cheapest first), or rounds of this share of the vertices, 0.01 to
    /// 0.5 [default: heap].
    #[arg(long, value_name = "heap | SHARE")]
    round_size: Option<Round>,
    /// Codec of the geometry: range (fewest bytes; chunks can be sent in part), axis-aligned (fewer bytes for models
    /// built along the axes), auto (one of these two, chosen per model) or zstd (least decoding work) [default: auto].
    #[arg(long, value_name = "CODEC", value_parser = by_name::<CodecChoice>())]
    codec: Option<CodecChoice>,
    /// Most faces simplified at once, 100 to 100,000,000. A larger mesh is simplified in spatial blocks, one after the
    /// other; a block takes about 300 bytes of memory per face [default: 4000000].
    #[arg(long, value_name = "N")]
    block_faces: Option<BlockFaces>,
    /// Depth of relief in units of texture coordinates, 0 to 1; replaces that of the materials.
    #[arg(long, value_name = "DEPTH")]
    relief_depth: Option<ReliefDepth>,
    /// Quality of textures (WebP), 1 to 100; 100 is lossless [default: 80].
    #[arg(long, value_name = "N")]
    texture_quality: Option<TextureQuality>,
    /// Work that goes into small packs: full, or least, for packs that stay on a machine: faster, with more bytes, and
    /// chunks that are not sent in part [default: full].
    #[arg(long, value_name = "EFFORT", value_parser = by_name::<Effort>())]
    effort: Option<Effort>,
}

/// Preparation settings of scenes, whose models may have many meshes.
#[derive(Clone, Copy, Debug, Args)]
pub(super) struct SceneArguments {
    #[command(flatten)]
    preparation: PreparationArguments,
    /// Whether many small meshes of a glTF file are gathered into batches: auto, off (each mesh is an asset), or the most
    /// faces of a batch, 1,000 to 10,000,000 [default: auto].
    #[arg(long, value_name = "auto | off | FACES")]
    batch: Option<Batching>,
    /// Whether scenes of many instances get proxies, meshes that stand for many instances far away: auto or off [default:
    /// as the scene file says, else auto].
    #[arg(long, value_name = "auto | off", value_parser = auto_or_off)]
    proxies: Option<bool>,
}

impl SceneArguments {
    pub(super) fn resolve(self) -> PreparationSettings {
        PreparationSettings { batching: self.batch, proxies: self.proxies, ..self.preparation.resolve() }
    }
}

impl PreparationArguments {
    pub(super) fn resolve(self) -> PreparationSettings {
        let PrecisionArguments { position_bits, tolerance } = self.precision;
        PreparationSettings {
            precision: position_bits.map(Precision::Bits).or(tolerance.map(Precision::Tolerance)),
            uv_bits: self.uv_bits,
            normal_tolerance: self.normal_tolerance,
            crease_angle: self.crease_angle,
            metric: self.metric,
            round: self.round_size,
            codec: self.codec,
            block_faces: self.block_faces,
            relief_depth: self.relief_depth,
            texture_quality: self.texture_quality,
            effort: self.effort,
            // One model is one pack.
            batching: None,
            proxies: None,
        }
    }
}

/// Parses a value by its name; help, completions and errors list the names. The choices belong to libraries without
/// clap, so they cannot derive its `ValueEnum`.
pub(super) fn by_name<T: Named>() -> impl TypedValueParser<Value = T> {
    let names = PossibleValuesParser::new(T::ALL.iter().map(|value| value.name()));
    names.try_map(|name| T::from_name(&name))
}

fn auto_or_off(text: &str) -> Result<bool, String> {
    match text {
        "auto" => Ok(true),
        "off" => Ok(false),
        _ => Err("must be auto or off".to_owned()),
    }
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("must be a positive number".to_owned()),
    }
}
