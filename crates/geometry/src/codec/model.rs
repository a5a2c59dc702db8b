//! The contexts of chunks and of base meshes: where each kind of decision keeps its probabilities.

use std::sync::LazyLock;

use crate::entropy::context::{Contexts, MAX_INPUTS, Prob};
use crate::entropy::range_coder::MIX_TREE_BITS;
use crate::entropy::symbols::{INTEGER_CONTEXTS, tree_contexts};
use crate::entropy::zstd_streams::StreamTable;

/// Valences up to this have contexts of their own.
pub(crate) const MAX_VALENCE: usize = 12;
/// Classes of a split flag's star area.
pub(crate) const AREAS: usize = 16;
/// Splits since the chunk's start, counted up to this.
pub(crate) const DEPTHS: usize = 4;
/// Segments of a chunk that are told apart; later ones count as the last.
pub(crate) const SEGMENTS: usize = 3;
/// Classes of bentness.
pub(crate) const BENDS: usize = 8;
/// Buckets of the expected size of a residual.
pub(crate) const SIZES: usize = 28;
/// Classes of how the last residuals compared with what was expected.
pub(crate) const RECENTS: usize = 4;
/// Classes of how the residual before compared with what was expected of it.
pub(crate) const OTHERS: usize = 8;
/// Bits of a residual's class.
pub(crate) const CLASS_BITS: u32 = MIX_TREE_BITS;
pub(crate) const CLASSES: usize = tree_contexts(CLASS_BITS);

/// Bits that a vertex's position gains, told apart up to this.
pub(crate) const MOVE_STEPS: usize = 4;
/// Steps between grids that are told apart.
pub(crate) const SHIFT_STEPS: usize = 6;

/// Contexts of a base mesh's decision: no earlier part is known to be like this one, or one decided no, or yes.
pub(crate) const TOLD: usize = 3;
/// Guesses at a number of a base mesh that one may be chosen of.
pub(crate) const MOST_CHOICES: usize = 12;

/// Coordinates of neighbours that one of a vertex may repeat: those nearest to the guess.
pub(crate) const MOST_REPEATED: usize = 4;
/// Neighbours that share a coordinate, told apart up to this.
pub(crate) const SHARERS: usize = 4;
/// Neighbours that do not share the nearest coordinate, and the old vertex, told apart up to one less than this.
pub(crate) const NOT_SHARERS: usize = 6;
/// Distances between a coordinate and the guess, in quarters of the ring's radius, told apart up to one less than this.
pub(crate) const GAPS: usize = 9;
/// Classes of how far a ring's normal leans to an axis.
pub(crate) const TILTS: usize = 8;
/// Whether the two coordinates before were repeated, a bit each.
pub(crate) const BEFORE: usize = 4;
/// Classes of how two faces are bent against each other.
pub(crate) const FACE_BENDS: usize = 4;
/// Corners of a new face, and one of a face that moved.
pub(crate) const CORNERS: usize = 4;
/// Places for which projections of textures and what else is expected are compared.
pub(crate) const PLACES: usize = 3;

/// Contexts of one kind of residual: by recent ratios, and by the residual before.
pub(crate) const SIZE_RECENT_CONTEXTS: usize = SIZES * RECENTS * CLASSES;
pub(crate) const SIZE_OTHER_CONTEXTS: usize = SIZES / 2 * OTHERS * CLASSES;

macro_rules! layout {
    ($total:ident: $($name:ident = $count:expr),* $(,)?) => {
        #[allow(non_snake_case, dead_code, reason = "its fields are only counted, by the constants' names")]
        #[repr(C)]
        struct Layout { $($name: [u8; $count]),* }
        $(pub(crate) const $name: usize = core::mem::offset_of!(Layout, $name);)*
        pub(crate) const $total: usize = size_of::<Layout>();
    };
}

layout! { CONTEXTS:
    BIRTHS = INTEGER_CONTEXTS,
    BIRTH_AXIS = INTEGER_CONTEXTS,
    MORE_SEEDS = 1,
    SEED_INTERIOR = 1,
    SEED_OWNER = INTEGER_CONTEXTS,
    INTERIOR = 36,
    FLAG_AREA = AREAS * DEPTHS * SEGMENTS,
    FLAG_BEND = AREAS * BENDS * SEGMENTS,
    FLAG_VALENCE = DEPTHS * (MAX_VALENCE + 1) * 4 * SEGMENTS,
    SHIFT = 2 * SHIFT_STEPS,
    SINGLE_RUN = 2,
    RUN_LENGTH = tree_contexts(4) * (MAX_VALENCE + 1) * 2,
    LONG_RUN = INTEGER_CONTEXTS,
    RUN_START = (MAX_VALENCE + 1) * 8,
    RUN_GAP = 8 * 16,
    LABEL = 2,
    CUT = 4,
    EXTRAS = INTEGER_CONTEXTS,
    EXTRA_IN_RING = 1,
    SAME_MOVED_WEDGE = 1,
    NEW_MOVED_WEDGE = 1,
    SAME_WEDGE = 3,
    NEW_WEDGE = 3,
    GROUP = 2 * INTEGER_CONTEXTS,
    UV_RECENT = 2 * SIZE_RECENT_CONTEXTS,
    UV_OTHER = 2 * SIZE_OTHER_CONTEXTS,
    UV_SIGN = 2,
    UV_REST = INTEGER_CONTEXTS,
    SAME_COLOR = 1,
    COLOR = 4 * INTEGER_CONTEXTS,
    EXPLICIT_NORMAL = 3,
    NORMAL = 2 * INTEGER_CONTEXTS,
    SAME_MATERIAL = 1,
    MATERIAL = INTEGER_CONTEXTS,
    MOVE_ALONG = (MOVE_STEPS + 1) * tree_contexts(4),
    MOVE_ACROSS = (MOVE_STEPS + 1) * tree_contexts(4),
    MOVE_REST = INTEGER_CONTEXTS,
    RESIDUAL_RECENT = 3 * SIZE_RECENT_CONTEXTS,
    RESIDUAL_OTHER = 3 * SIZE_OTHER_CONTEXTS,
    RESIDUAL_SIGN = 3,
    RESIDUAL_REST = INTEGER_CONTEXTS,
    BASE_MORE = 1,
    BASE_GATE = TOLD,
    BASE_NEW_VERTEX = 4 * TOLD,
    BASE_LIKELY_VERTEX = TOLD,
    BASE_WHICH_VERTEX = 2 * TOLD,
    BASE_SAME_WEDGE = 5 * TOLD,
    BASE_NEW_WEDGE = TOLD,
    BASE_CHOICE = 12 * MOST_CHOICES,
    BASE_UV = 2 * INTEGER_CONTEXTS,
    BASE_SAME_GROUP = 6,
    BASE_SAME_MATERIAL = 1,
    BASE_MATERIAL = INTEGER_CONTEXTS,
    INDEX_LEVEL = INTEGER_CONTEXTS,
    INDEX_RADIUS = INTEGER_CONTEXTS,
    INDEX_ERROR = INTEGER_CONTEXTS,
    INDEX_ATTRIBUTE = INTEGER_CONTEXTS,
    INDEX_PARENTS = INTEGER_CONTEXTS,
    INDEX_FIRST_PARENT = INTEGER_CONTEXTS,
    INDEX_NEXT_PARENT = INTEGER_CONTEXTS,
    INDEX_VERTICES = INTEGER_CONTEXTS,
    INDEX_WEDGES = INTEGER_CONTEXTS,
    INDEX_FACES = INTEGER_CONTEXTS,
    INDEX_BYTES = INTEGER_CONTEXTS,
    INDEX_STOPS = INTEGER_CONTEXTS,
    INDEX_STOP_VERTICES = INTEGER_CONTEXTS,
    INDEX_STOP_WEDGES = INTEGER_CONTEXTS,
    INDEX_STOP_FACES = INTEGER_CONTEXTS,
    INDEX_STOP_BYTES = INTEGER_CONTEXTS,
    INDEX_STOP_ERROR = INTEGER_CONTEXTS,
    AXIS_SAME_WEDGE = 2 * FACE_BENDS * (CORNERS - 1),
    AXIS_LIKELY_WEDGE = CORNERS - 1,
    AXIS_NEW_WEDGE = (CORNERS - 1) * 2,
    AXIS_GROUP = 4,
    AXIS_SIDE = INTEGER_CONTEXTS,
    AXIS_COPIED = CORNERS * 2 * 2 * 2,
    AXIS_COPY = INTEGER_CONTEXTS,
    AXIS_LIKE_NEAR = PLACES,
    AXIS_UV = 2 * PLACES * 3 * INTEGER_CONTEXTS,
    REPEATS_SO_FAR = 3 * BEFORE * 2,
    REPEATS_TILT = TILTS * NOT_SHARERS,
    REPEATS_NEAR = GAPS * SHARERS * MOST_REPEATED,
    WHICH_SHARERS = (MOST_REPEATED - 1) * SHARERS * SHARERS * (MOST_REPEATED + 1),
    WHICH_GAPS = (MOST_REPEATED - 1) * GAPS * (GAPS + 1),
    WHICH_REST = (MOST_REPEATED - 1) * NOT_SHARERS * BEFORE,
}

/// Where [`crate::entropy::zstd_streams`]'s streams begin in the layout. Bytes: what is rare; lengths and starts
/// of runs; groups; texture coordinates by axis; colours and normals; moves; residuals of positions by step, with
/// the base mesh. Bits: of the region; of splits; of connectivity; of wedges, materials and the base mesh.
pub(crate) static STREAMS: StreamTable<11, 4> = StreamTable {
    byte_starts: [
        0,
        RUN_LENGTH,
        RUN_START,
        EXTRAS,
        UV_RECENT,
        UV_RECENT + SIZE_RECENT_CONTEXTS,
        SAME_COLOR,
        MOVE_ALONG,
        RESIDUAL_RECENT,
        RESIDUAL_RECENT + SIZE_RECENT_CONTEXTS,
        RESIDUAL_RECENT + 2 * SIZE_RECENT_CONTEXTS,
    ],
    bit_starts: [0, FLAG_AREA, SINGLE_RUN, EXTRA_IN_RING],
};

/// Mixers.
pub(crate) const MIX_FLAG: usize = 0;
pub(crate) const MIX_START: usize = 1;
pub(crate) const MIX_RESIDUAL: usize = 2;
pub(crate) const MIX_UV: usize = 5;
pub(crate) const MIX_REPEATS: usize = 7;
pub(crate) const MIX_WHICH: usize = 10;
pub(crate) const MIXERS: usize = 13;

/// The trained priors ([`crate::prepare::training`]): part of the format, as its version says.
static PRIORS: &[u8] = include_bytes!("priors.bin");
/// Bytes of the table: per context a probability and what it is worth, per mixer its weights.
const PRIOR_BYTES: usize = CONTEXTS * 3 + MIXERS * MAX_INPUTS * 4;

/// What every stream starts from.
pub(crate) fn contexts() -> Contexts {
    trained().clone()
}

/// The same, in memory of contexts that are of no more use.
pub(crate) fn contexts_in(old: Option<Contexts>) -> Contexts {
    let Some(mut contexts) = old else { return contexts() };
    contexts.probs.clone_from(&trained().probs);
    contexts.weights.clone_from(&trained().weights);
    contexts
}

fn trained() -> &'static Contexts {
    // While the layout changes the table does not fit it, and training starts from nothing.
    static TRAINED: LazyLock<Contexts> = LazyLock::new(|| {
        if PRIORS.len() == PRIOR_BYTES { Contexts::from_bytes(PRIORS, CONTEXTS) } else { untrained() }
    });
    &TRAINED
}

/// What training starts from: nothing known, all inputs of a mixer worth the same.
pub(crate) fn untrained() -> Contexts {
    Contexts { probs: vec![Prob::default(); CONTEXTS], weights: vec![[26_000; MAX_INPUTS]; MIXERS] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_fits_the_layout() {
        assert_eq!(PRIORS.len(), PRIOR_BYTES, "train the priors again");
    }
}
