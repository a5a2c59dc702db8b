//! Options of preparation, shared by `prepare` and `serve`.

use clap::Args;
use lodestream_bake::preparation_settings::{
    BlockFaces, CodecChoice, NormalTolerance, PositionBits, Precision, PreparationSettings, ReliefDepth,
    Round, Tolerance, UvBits,
};
use lodestream_geometry::Metric;

/// How finely positions are kept; one of the two, or neither for the default.
#[derive(Clone, Copy, Debug, Args)]
#[group(required = false, multiple = false)]
struct PrecisionArguments {
    /// Bits per axis of positions, 4 to 24. More bits cost about 3 bits a vertex each [default: 14].
    #[arg(long, value_name = "N")]
    position_bits: Option<PositionBits>,
    /// Largest error of a position, in the model's units; decides the bits.
    #[arg(long, value_name = "LENGTH")]
    tolerance: Option<Tolerance>,
}

/// What a pack should hold, and how it is made.
#[derive(Clone, Copy, Debug, Args)]
pub(super) struct PreparationArguments {
    #[command(flatten)]
    precision: PrecisionArguments,
    /// Bits per axis of texture coordinates, 1 to 16 [default: 12].
    #[arg(long, value_name = "N")]
    uv_bits: Option<UvBits>,
    /// Largest angle between a normal of the model and what its faces say before the normal is sent:
    /// 0 sends all, 180 none [default: 10].
    #[arg(long, value_name = "DEGREES")]
    normal_tolerance: Option<NormalTolerance>,
    /// What a collapse is held to cost: qem (quadric error), melax (length × curvature), clustering (the cell that both
    /// ends share) or clustering-seams (the same, along seams) [default: qem].
    #[arg(long, value_name = "METRIC")]
    metric: Option<Metric>,
    /// Order of collapses: heap (the cheapest first), or rounds of this share of the vertices, 0.01 to
    /// 0.5 [default: heap].
    #[arg(long, value_name = "heap | SHARE")]
    round_size: Option<Round>,
    /// How the geometry is coded: range (the fewest bytes; chunks may be sent in part), built (fewer for what is made of
    /// parts along the axes), auto (whichever of these suits the model) or zstd (less to do for clients) [default: auto].
    #[arg(long, value_name = "CODEC")]
    codec: Option<CodecChoice>,
    /// Most faces that are simplified at once, 100 to 100,000,000: a mesh of more is simplified in blocks of space, one after
    /// the other, in some 300 bytes a face of a block [default: 4000000].
    #[arg(long, value_name = "N")]
    block_faces: Option<BlockFaces>,
    /// Depth of relief, 0 to 1 in units of texture coordinates, instead of what the materials say.
    #[arg(long, value_name = "DEPTH")]
    relief_depth: Option<ReliefDepth>,
}

impl PreparationArguments {
    pub(super) fn resolve(self) -> PreparationSettings {
        let PrecisionArguments { position_bits, tolerance } = self.precision;
        PreparationSettings {
            precision: position_bits.map(Precision::Bits).or(tolerance.map(Precision::Tolerance)),
            uv_bits: self.uv_bits,
            normal_tolerance: self.normal_tolerance,
            metric: self.metric,
            round: self.round_size,
            codec: self.codec,
            block_faces: self.block_faces,
            relief_depth: self.relief_depth,
        }
    }
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("a positive number is needed".to_owned()),
    }
}
