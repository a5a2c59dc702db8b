//! Errors of terrains, their features, and requests for heights.

/// An invalid terrain or feature, or heights that do not exist.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TerrainError {
    /// A parameter outside its range.
    #[error("terrain parameter {name} is {value}, must be {range}")]
    BadParameter {
        /// Name of the parameter.
        name: &'static str,
        /// Its value.
        value: i64,
        /// Its valid range.
        range: &'static str,
    },
    /// Parameters that allow heights beyond the safe integer range.
    #[error(
        "terrain heights can reach ±{worst}, more than {limit}: lower the amplitude, the roughness or the base"
    )]
    TooHigh {
        /// The largest magnitude that a height without features can have.
        worst: u64,
        /// The largest magnitude allowed.
        limit: u64,
    },
    /// A level that the terrain does not have.
    #[error("level {level} is outside {lowest}..={finest}")]
    NoSuchLevel {
        /// The level asked for.
        level: i64,
        /// The coarsest there is.
        lowest: i64,
        /// The finest there is.
        finest: i64,
    },
    /// A rectangle of points that is not inside the world.
    #[error("points {x}, {y} to {x_end}, {y_end} of level {level} reach outside the world, ±{edge}")]
    OutsideWorld {
        /// The level asked for.
        level: i8,
        /// First column.
        x: i64,
        /// First row.
        y: i64,
        /// Last column.
        x_end: i64,
        /// Last row.
        y_end: i64,
        /// Largest coordinate of the level.
        edge: i64,
    },
    /// A patch that is not in the world.
    #[error("patch {x}, {y} is outside the world, -{edge} to {edge} - 1")]
    NoSuchPatch {
        /// Its column.
        x: i64,
        /// Its row.
        y: i64,
        /// Patches from the middle of the world to its edge.
        edge: i64,
    },
    /// A rectangle without points, or with too many.
    #[error("a window of {width} x {height} points, must have 1 to {limit} points")]
    BadWindow {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Most points of a window.
        limit: usize,
    },
    /// Too many features.
    #[error("{count} {what}, at most {limit} are possible")]
    TooMany {
        /// The kind of feature.
        what: &'static str,
        /// How many were given.
        count: usize,
        /// How many are allowed.
        limit: usize,
    },
    /// An invalid feature.
    #[error("feature set {set}: {what} {index}: {why}")]
    BadFeature {
        /// Index of the set.
        set: usize,
        /// Its kind: a point or a stamp.
        what: &'static str,
        /// Its index in the set.
        index: usize,
        /// What is wrong with it.
        why: String,
    },
    /// An invalid height override of a patch.
    #[error("point {x}, {y} of a patch {why}")]
    BadPoint {
        /// Its column in the patch.
        x: u16,
        /// Its row in the patch.
        y: u16,
        /// What is wrong with it.
        why: &'static str,
    },
}
