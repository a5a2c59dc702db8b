//! Context layout of chunks and base meshes: the range of contexts of each kind of decision.

use std::sync::LazyLock;

use crate::entropy::context::{Contexts, MAX_INPUTS, Prob};
use crate::entropy::range_coder::MIX_TREE_BITS;
use crate::entropy::symbols::{INTEGER_CONTEXTS, tree_contexts};
use crate::entropy::zstd_streams::StreamTable;
use crate::mesh::skin::MAX_INFLUENCES;

/// Valences up to this have separate contexts.
pub(crate) const MAX_VALENCE: usize = 12;
/// Classes of a split flag's star area.
pub(crate) const AREAS: usize = 16;
/// Split depths (passes since the chunk's start), counted up to this.
pub(crate) const DEPTHS: usize = 4;
/// Segments of a chunk with separate contexts; later ones count as the last.
pub(crate) const SEGMENTS: usize = 3;
/// Classes of the bending of a star.
pub(crate) const BENDS: usize = 8;
/// Buckets of the expected size of a residual.
pub(crate) const SIZES: usize = 28;
/// Classes of the recent ratios of residuals to their expected sizes.
pub(crate) const RECENTS: usize = 4;
/// Classes of the previous residual's ratio to its expected size.
pub(crate) const OTHERS: usize = 8;
/// Bits of a residual's class.
pub(crate) const CLASS_BITS: u32 = MIX_TREE_BITS;
pub(crate) const CLASSES: usize = tree_contexts(CLASS_BITS);

/// Number of bits that a vertex's position gains, clamped to this.
pub(crate) const MOVE_STEPS: usize = 4;
/// Number of distinguished steps between grids.
pub(crate) const SHIFT_STEPS: usize = 6;

/// Contexts per decision of a base mesh: no matching component is known, or one decided false, or true.
pub(crate) const REPEAT_STATES: usize = 3;
/// Most candidates for a number of a base mesh that can be coded.
pub(crate) const MAX_CHOICES: usize = 12;

/// Most coordinates of neighbours that a new vertex's coordinate may repeat: those nearest to the prediction.
pub(crate) const MAX_REPEATED: usize = 4;
/// Number of neighbours that share a coordinate, clamped to this.
pub(crate) const SHARERS: usize = 4;
/// Number of neighbours (and the old vertex) that do not share the nearest coordinate, clamped below this.
pub(crate) const NOT_SHARERS: usize = 6;
/// Distance between a coordinate and the prediction, in quarters of the ring's radius, clamped below this.
pub(crate) const GAPS: usize = 9;
/// Classes of the angle between a ring's normal and an axis.
pub(crate) const TILTS: usize = 8;
/// Whether the two previous coordinates were repeated, a bit each.
pub(crate) const BEFORE: usize = 4;
/// Classes of the dihedral angle of two faces.
pub(crate) const FACE_BENDS: usize = 4;
/// Corners of a new face, and one of a moved face.
pub(crate) const CORNERS: usize = 4;
/// Places at which projections of textures are compared with other predictions.
pub(crate) const PLACES: usize = 3;

/// Joints of neighbours that are expected to move a new vertex.
pub(crate) const MAX_EXPECTED: usize = 8;
/// Classes of an expected weight.
pub(crate) const WEIGHT_CLASSES: usize = 8;
/// Bits of a joint's number.
pub(crate) const JOINT_BITS: u32 = 8;

/// Places of a new wedge that may share a set of texture coordinates with another wedge of its vertex.
pub(crate) const SHARED_PLACES: usize = 4;

/// Contexts per kind of residual: by recent ratios, and by the previous residual.
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
    BASE_GATE = REPEAT_STATES,
    BASE_NEW_VERTEX = 4 * REPEAT_STATES,
    BASE_LIKELY_VERTEX = REPEAT_STATES,
    BASE_WHICH_VERTEX = 2 * REPEAT_STATES,
    BASE_SAME_WEDGE = 5 * REPEAT_STATES,
    BASE_NEW_WEDGE = REPEAT_STATES,
    BASE_CHOICE = 12 * MAX_CHOICES,
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
    REPEATS_NEAR = GAPS * SHARERS * MAX_REPEATED,
    WHICH_SHARERS = (MAX_REPEATED - 1) * SHARERS * SHARERS * (MAX_REPEATED + 1),
    WHICH_GAPS = (MAX_REPEATED - 1) * GAPS * (GAPS + 1),
    WHICH_REST = (MAX_REPEATED - 1) * NOT_SHARERS * BEFORE,
    BASE_PART = INTEGER_CONTEXTS,
    BIRTH_PART = INTEGER_CONTEXTS,
    SKIN_SAME = 1,
    SKIN_PRESENT = MAX_EXPECTED * WEIGHT_CLASSES,
    SKIN_ANOTHER = MAX_INFLUENCES,
    SKIN_JOINT = tree_contexts(JOINT_BITS),
    SKIN_WEIGHT = (MAX_INFLUENCES - 1) * INTEGER_CONTEXTS,
    SHARED_UV = SHARED_PLACES,
    SHARED_SECOND_UV = 3 * SHARED_PLACES,
}

/// Assigns contexts to the streams of [`crate::entropy::zstd_streams`]. Byte streams: rare symbols; lengths and
/// starts of runs; groups; texture coordinates by axis; colours and normals; moves; residuals of positions by step,
/// with the base mesh. Bit streams: region; splits; connectivity; wedges, materials and the base mesh.
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

/// The trained priors ([`crate::prepare::training`]): part of the format and covered by its version.
static PRIORS: &[u8] = include_bytes!("priors.bin");
/// Bytes of the table: a probability with its count per context, weights per mixer.
const PRIOR_BYTES: usize = CONTEXTS * 3 + MIXERS * MAX_INPUTS * 4;

/// The initial contexts of every stream.
pub(crate) fn contexts() -> Contexts {
    trained().clone()
}

/// The initial contexts, in reused memory.
pub(crate) fn contexts_in(old: Option<Contexts>) -> Contexts {
    let Some(mut contexts) = old else { return contexts() };
    contexts.probs.clone_from(&trained().probs);
    contexts.weights.clone_from(&trained().weights);
    contexts
}

fn trained() -> &'static Contexts {
    // When the layout changes, the table does not fit, and training starts from untrained contexts.
    static TRAINED: LazyLock<Contexts> = LazyLock::new(|| {
        if PRIORS.len() == PRIOR_BYTES { Contexts::from_bytes(PRIORS, CONTEXTS) } else { untrained() }
    });
    &TRAINED
}

/// Untrained contexts: probabilities of one half, equal mixing weights.
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
