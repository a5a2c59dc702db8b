//! Training of the priors that every stream starts from (`codec/model.rs`).
//!
//! The table belongs to the format: after training, [`crate::base::FORMAT_VERSION`] must change. Per
//! context the trained pair (probability, what it is worth) is the one that codes the sequences seen,
//! chunk by chunk, in the fewest bits; weights of mixers are the means of those that chunks end with.

use std::collections::BTreeMap;
use std::sync::Mutex;

use crate::codec::base::{BaseMesh, encode_with as encode_base};
use crate::codec::chunk::encode_with;
use crate::codec::model::{CONTEXTS, untrained};
use crate::context::{Contexts, Prob};
use crate::error::{DecodeError, MeshError};
use crate::index::{CHUNKS_PER_PAGE, code_page};
use crate::mesh::QuantisedMesh;
use crate::pool::{Pool, Silent};
use crate::prepare::{Observer, prepare_observed};
use crate::range_coder::Coder;
use crate::simplify::Settings;

/// Rounds in which the weights of mixers settle.
const WEIGHT_ROUNDS: usize = 3;
/// What a prior may be worth.
const WORTHS: [u8; 11] = [0, 1, 2, 4, 7, 12, 20, 35, 60, 90, 120];
/// Log odds by which a prior may differ from the mean over all chunks.
const SHIFTS: [f64; 3] = [-0.3, 0.0, 0.3];

/// A coder that writes nothing down but which context saw which bit.
struct Recorder {
    contexts: Contexts,
    seen: Vec<(u32, bool)>,
}

impl Recorder {
    fn new(contexts: Contexts) -> Self {
        Self { contexts, seen: Vec::new() }
    }
}

impl Coder for Recorder {
    fn bit(&mut self, context: usize, value: bool) -> bool {
        self.seen.push((context as u32, value));
        self.contexts.probs[context].update(value);
        value
    }

    fn mix<const N: usize>(&mut self, contexts: [usize; N], mixer: usize, value: bool) -> bool {
        self.seen.extend(contexts.map(|c| (c as u32, value)));
        let mixed = self.contexts.mixed(contexts, mixer);
        self.contexts.learn(contexts, mixer, &mixed, value);
        value
    }

    fn raw(&mut self, _bits: u32, value: u32) -> u32 {
        value
    }

    fn check(&self) -> Result<(), DecodeError> {
        Ok(())
    }
}

/// Trains on the chunks and base meshes of some meshes; answers the table's bytes.
///
/// Cost: preparing every mesh five times. Uses floating-point logarithms: the table is the same on one
/// machine, not on all.
///
/// # Errors
/// As [`crate::prepare::prepare`].
pub fn train(meshes: &[QuantisedMesh], settings: &Settings, pool: &dyn Pool) -> Result<Vec<u8>, MeshError> {
    let mut contexts = untrained();
    let streams = record(meshes, settings, pool, &contexts)?;
    contexts.probs = priors(&streams);
    for _ in 0..WEIGHT_ROUNDS {
        let streams = record(meshes, settings, pool, &contexts)?;
        let count = streams.len().max(1) as i64;
        for (i, weight) in contexts.weights.as_flattened_mut().iter_mut().enumerate() {
            let sum: i64 = streams.iter().map(|s| i64::from(s.contexts.weights.as_flattened()[i])).sum();
            *weight = (sum / count) as i32;
        }
    }
    Ok(contexts.to_bytes())
}

fn record(
    meshes: &[QuantisedMesh],
    settings: &Settings,
    pool: &dyn Pool,
    contexts: &Contexts,
) -> Result<Vec<Recorder>, MeshError> {
    let mut all = Vec::new();
    for mesh in meshes {
        let streams = Mutex::new(BTreeMap::new());
        let observe: Observer<'_> = &|active, chunk, source| {
            let mut recorder = Recorder::new(contexts.clone());
            if encode_with(&mut recorder, active, chunk, source).is_ok()
                && let Ok(mut streams) = streams.lock()
            {
                streams.insert(chunk, recorder);
            }
        };
        let prepared = prepare_observed(mesh, settings, pool, &Silent, (observe, &Ok))?;
        all.extend(streams.into_inner().unwrap_or_default().into_values());
        let base = &prepared.base;
        let mesh = BaseMesh {
            positions: base.positions.clone(),
            wedges: base.wedges.clone(),
            faces: base.faces.clone(),
        };
        let mut recorder = Recorder::new(contexts.clone());
        encode_base(&mut recorder, &mesh, base.grid.bits, base.kinds(), base.material_count)
            .map_err(|e| MeshError::Internal { why: e.to_string() })?;
        all.push(recorder);
        for (page, infos) in prepared.infos.chunks(CHUNKS_PER_PAGE).enumerate() {
            let mut recorder = Recorder::new(contexts.clone());
            code_page(&mut recorder, (page * CHUNKS_PER_PAGE) as u32, Some(infos))
                .map_err(|e| MeshError::Internal { why: e.to_string() })?;
            all.push(recorder);
        }
    }
    Ok(all)
}

fn priors(streams: &[Recorder]) -> Vec<Prob> {
    let mut runs: Vec<Vec<Vec<bool>>> = vec![Vec::new(); CONTEXTS];
    for stream in streams {
        let mut own: BTreeMap<u32, Vec<bool>> = BTreeMap::new();
        for &(context, bit) in &stream.seen {
            own.entry(context).or_default().push(bit);
        }
        for (context, run) in own {
            runs[context as usize].push(run);
        }
    }
    runs.iter().map(|runs| prior(runs)).collect()
}

/// The cheapest prior for some runs of one context.
fn prior(runs: &[Vec<bool>]) -> Prob {
    let bits: usize = runs.iter().map(Vec::len).sum();
    if bits == 0 {
        return Prob::default();
    }
    let set = runs.iter().flatten().filter(|b| **b).count();
    let share = (set as f64 + 0.4) / (bits as f64 + 0.8);
    let mut best = (f64::INFINITY, Prob::default());
    for shift in SHIFTS {
        let odds = share / (1.0 - share) * f64::exp(shift);
        let p = (odds / (1.0 + odds) * 65536.0).clamp(48.0, 65488.0) as u16;
        for seen in WORTHS.into_iter().filter(|&w| usize::from(w) <= bits + 1) {
            let prior = Prob { p, seen };
            let cost = runs.iter().map(|run| cost(prior, run)).sum();
            if cost < best.0 {
                best = (cost, prior);
            }
        }
    }
    best.1
}

fn cost(mut prob: Prob, run: &[bool]) -> f64 {
    let mut bits = 0.0;
    for &bit in run {
        let p = f64::from(prob.p) / 65536.0;
        bits -= if bit { p } else { 1.0 - p }.log2();
        prob.update(bit);
    }
    bits
}
