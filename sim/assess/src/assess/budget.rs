//! Bytes required for a quality, given as RMS distance.

use lodestream_geometry::ancestor_closed_cut::{self, Budget};
use serde::Serialize;

use super::model::Model;
use super::options::Options;
use super::quality::distance;

/// Target RMS distances, relative to the diagonal.
const TARGETS: [f64; 3] = [100e-5, 40e-5, 20e-5];
/// Relative precision of the search for budgets.
const PRECISION: f64 = 0.005;

/// The smallest budget found whose lowest-error ancestor-closed cut reaches an RMS distance.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct BytesToRms {
    /// Target RMS distance, two-sided, relative to the diagonal.
    pub target: f64,
    /// RMS distance of the cut.
    pub rms: f64,
    /// Faces of the cut.
    pub faces: usize,
    /// Bytes of base mesh, whole index and the cut's payloads.
    pub bytes: u64,
}

/// Bisects for every target that the whole asset reaches. The cut for a larger budget is rarely worse, so the result is
/// near the minimum.
pub(super) fn bytes_to_rms(model: &Model, head: u64, options: &Options) -> anyhow::Result<Vec<BytesToRms>> {
    let prepared = &model.prepared;
    let all: u64 = prepared.infos.iter().map(|i| u64::from(i.payload_bytes)).sum();
    let mut found = Vec::new();
    for target in TARGETS {
        let (mut low, mut high) = (head as f64, (head + all) as f64);
        let mut best = None;
        while high - low > PRECISION * high || best.is_none() {
            let budget = if best.is_none() { high } else { 0.5 * (low + high) };
            let set = ancestor_closed_cut::lowest_error(
                &prepared.base,
                &prepared.infos,
                head,
                Budget::Bytes(budget as u64),
            );
            let (faces, comparison) = distance(model, &set.members, options)?;
            let rms = comparison.rms;
            if rms <= target {
                best = Some(BytesToRms { target, rms, faces, bytes: set.bytes });
                high = set.bytes as f64;
            } else if best.is_none() {
                break;
            } else {
                low = budget;
            }
        }
        found.extend(best);
    }
    Ok(found)
}
