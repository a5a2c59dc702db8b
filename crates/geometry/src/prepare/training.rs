//! Training of the priors that every stream starts from (`codec/model.rs`).
//!
//! The table is part of the format: after training, [`crate::asset::base::FORMAT_VERSION`] must change. Each
//! context's prior (probability and count) is the one that codes the recorded sequences, chunk by chunk, in the
//! fewest bits; mixing weights are the means of the final weights of the chunks.

use std::collections::BTreeMap;
use std::sync::Mutex;

use crate::asset::index::CHUNKS_PER_PAGE;
use crate::codec::base::encode_with as encode_base;
use crate::codec::base::mesh::{BaseFormat, BaseMesh};
use crate::codec::chunk::encode_with;
use crate::codec::index_page::code_page;
use crate::codec::model::{CONTEXTS, untrained};
use crate::entropy::context::{Contexts, MAX_INPUTS, Prob};
use crate::entropy::range_coder::Coder;
use crate::error::{DecodeError, MeshError};
use crate::mesh::QuantisedMesh;
use crate::pool::{Pool, Silent};
use crate::prepare::{Hooks, Observer, prepare};
use crate::simplify::settings::Settings;

/// Iterations for the mixing weights.
const WEIGHT_ROUNDS: usize = 24;
/// Candidate counts of a prior.
const COUNTS: [u8; 11] = [0, 1, 2, 4, 7, 12, 20, 35, 60, 90, 120];
/// Candidate offsets, in log odds, of a prior from the mean over all chunks.
const SHIFTS: [f64; 3] = [-0.3, 0.0, 0.3];

/// A coded decision: its contexts (the first `count`), the mixer if any, and the bit.
#[derive(Clone, Copy)]
struct Decision {
    contexts: [u32; MAX_INPUTS],
    count: u8,
    mixer: u16,
    bit: bool,
}

/// Records decisions with their contexts. These do not depend on probabilities, so one recording serves all
/// iterations.
#[derive(Default)]
struct Recorder(Vec<Decision>);

impl Coder for Recorder {
    fn bit(&mut self, context: usize, value: bool) -> bool {
        let contexts = [context as u32, 0, 0, 0];
        self.0.push(Decision { contexts, count: 1, mixer: 0, bit: value });
        value
    }

    fn mix<const N: usize>(&mut self, contexts: [usize; N], mixer: usize, value: bool) -> bool {
        let mut all = [0; MAX_INPUTS];
        for (to, from) in all.iter_mut().zip(contexts) {
            *to = from as u32;
        }
        self.0.push(Decision { contexts: all, count: N as u8, mixer: mixer as u16, bit: value });
        value
    }

    fn raw(&mut self, _bits: u32, value: u32) -> u32 {
        value
    }

    fn check(&self) -> Result<(), DecodeError> {
        Ok(())
    }
}

/// Trains on the chunks and base meshes of some meshes; returns the table's bytes.
///
/// Cost: 1.5 times preparing every mesh. Uses floating-point logarithms, so the table is reproducible on one machine
/// only.
///
/// # Errors
/// As [`crate::prepare::prepare`].
pub fn train(meshes: &[QuantisedMesh], settings: &Settings, pool: &dyn Pool) -> Result<Vec<u8>, MeshError> {
    let streams = record(meshes, settings, pool)?;
    let mut contexts = untrained();
    contexts.probs = priors(&streams);
    for _ in 0..WEIGHT_ROUNDS {
        contexts.weights = trained_weights(&contexts, &streams);
    }
    Ok(contexts.to_bytes())
}

/// Mean final weights of each mixer, weighted by its use in each stream.
fn trained_weights(start: &Contexts, streams: &[Recorder]) -> Vec<[i32; MAX_INPUTS]> {
    let mut sums = vec![[0_i64; MAX_INPUTS]; start.weights.len()];
    let mut uses = vec![0_i64; start.weights.len()];
    for stream in streams {
        let mut contexts = start.clone();
        let mut used = vec![0_i64; uses.len()];
        for d in &stream.0 {
            let [a, b, c, e] = d.contexts.map(|c| c as usize);
            let mixer = usize::from(d.mixer);
            match d.count {
                2 => replay(&mut contexts, [a, b], mixer, d.bit),
                3 => replay(&mut contexts, [a, b, c], mixer, d.bit),
                4 => replay(&mut contexts, [a, b, c, e], mixer, d.bit),
                _ => {
                    contexts.probs[a].update(d.bit);
                    continue;
                }
            }
            used[mixer] += 1;
        }
        for (mixer, used) in used.into_iter().enumerate() {
            uses[mixer] += used;
            for (sum, weight) in sums[mixer].iter_mut().zip(contexts.weights[mixer]) {
                *sum += i64::from(weight) * used;
            }
        }
    }
    let mean = |(sums, (uses, start)): (&[i64; MAX_INPUTS], (&i64, &[i32; MAX_INPUTS]))| match uses {
        0 => *start,
        uses => sums.map(|sum| (sum / uses) as i32),
    };
    sums.iter().zip(uses.iter().zip(&start.weights)).map(mean).collect()
}

fn replay<const N: usize>(contexts: &mut Contexts, at: [usize; N], mixer: usize, bit: bool) {
    let mixed = contexts.mixed(at, mixer);
    contexts.learn(at, mixer, &mixed, bit);
}

fn record(
    meshes: &[QuantisedMesh],
    settings: &Settings,
    pool: &dyn Pool,
) -> Result<Vec<Recorder>, MeshError> {
    let mut all = Vec::new();
    for mesh in meshes {
        let streams = Mutex::new(BTreeMap::new());
        let observe: Observer<'_> = &|active, chunk, source| {
            let mut recorder = Recorder::default();
            if encode_with(&mut recorder, active, chunk, source).is_ok()
                && let Ok(mut streams) = streams.lock()
            {
                streams.insert(chunk, recorder);
            }
        };
        let prepared = prepare(mesh, settings, &Hooks::new(pool, &Silent).with_observer(observe))?;
        all.extend(streams.into_inner().unwrap_or_default().into_values());
        let base = &prepared.base;
        let mesh = BaseMesh {
            positions: base.positions.clone(),
            wedges: base.wedges.clone(),
            faces: base.faces.clone(),
            parts: base.parts.clone(),
            skins: base.skins.clone(),
        };
        let mut recorder = Recorder::default();
        let format = BaseFormat::new(
            base.grid.bits,
            base.kinds(),
            base.material_count,
            base.part_count,
            [&base.uv_grid, &base.second_uv_grid],
        );
        encode_base(&mut recorder, &mesh, format, false)
            .map_err(|e| MeshError::Internal { why: e.to_string() })?;
        all.push(recorder);
        for (page, infos) in prepared.infos.chunks(CHUNKS_PER_PAGE).enumerate() {
            let mut recorder = Recorder::default();
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
        for d in &stream.0 {
            for &context in &d.contexts[..usize::from(d.count)] {
                own.entry(context).or_default().push(d.bit);
            }
        }
        for (context, run) in own {
            runs[context as usize].push(run);
        }
    }
    runs.iter().map(|runs| prior(runs)).collect()
}

/// The cheapest prior for the sequences of one context.
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
        for count in COUNTS.into_iter().filter(|&w| usize::from(w) <= bits + 1) {
            let prior = Prob { p, count };
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
