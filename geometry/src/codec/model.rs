//! The adaptive models of chunks: one context per kind of decision.

use crate::range_coder::Prob;
use crate::symbols::{Integer, Signed, Tree};

/// Valences up to this have contexts of their own.
pub(crate) const MAX_VALENCE: usize = 15;
/// Contexts of split flags: valence class × star area class.
pub(crate) const FLAG_CONTEXTS: usize = 24;

/// All contexts of a chunk; fresh for each chunk, since chunks are decoded in any order.
pub(crate) struct Model {
    pub(crate) births: Integer,
    pub(crate) birth_axis: [Signed; 3],
    pub(crate) more_seeds: Prob,
    pub(crate) seed_origin: Integer,
    pub(crate) interior: [Prob; 4],
    pub(crate) more_rounds: Prob,
    pub(crate) flags: [Prob; FLAG_CONTEXTS],
    pub(crate) single_run: Prob,
    pub(crate) run_length: Vec<Tree<5>>,
    pub(crate) long_run: Integer,
    pub(crate) run_start: Vec<Tree<5>>,
    pub(crate) label: [Prob; 2],
    /// By side and by whether faces are on both sides of the gate.
    pub(crate) gate: [Prob; 4],
    pub(crate) extras: Integer,
    pub(crate) extra_in_ring: Prob,
    pub(crate) same_moved_wedge: Prob,
    pub(crate) new_moved_wedge: Prob,
    /// By corner: t, x, u.
    pub(crate) same_wedge: [Prob; 3],
    pub(crate) new_wedge: [Prob; 3],
    pub(crate) group: [Integer; 2],
    pub(crate) uv: [Signed; 2],
    pub(crate) same_material: Prob,
    pub(crate) material: Integer,
    /// Position residuals by order of axes: two tangential, then the normal one.
    pub(crate) residual: [Residual; 3],
}

impl Default for Model {
    fn default() -> Self {
        Self {
            births: Integer::default(),
            birth_axis: Default::default(),
            more_seeds: Prob::default(),
            seed_origin: Integer::default(),
            interior: Default::default(),
            more_rounds: Prob::default(),
            flags: [Prob::default(); FLAG_CONTEXTS],
            single_run: Prob::default(),
            run_length: vec![Tree::default(); MAX_VALENCE + 1],
            long_run: Integer::default(),
            run_start: vec![Tree::default(); MAX_VALENCE + 1],
            label: Default::default(),
            gate: Default::default(),
            extras: Integer::default(),
            extra_in_ring: Prob::default(),
            same_moved_wedge: Prob::default(),
            new_moved_wedge: Prob::default(),
            same_wedge: Default::default(),
            new_wedge: Default::default(),
            group: Default::default(),
            uv: Default::default(),
            same_material: Prob::default(),
            material: Integer::default(),
            residual: Default::default(),
        }
    }
}

/// A residual whose size is coded relative to the local edge length.
#[derive(Clone, Debug)]
pub(crate) struct Residual {
    pub(crate) class: Tree<6>,
    pub(crate) second: [Prob; 64],
}

impl Default for Residual {
    fn default() -> Self {
        Self { class: Tree::default(), second: [Prob::default(); 64] }
    }
}
