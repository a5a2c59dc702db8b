//! Robustness against damaged bytes: packs read by server and client, frames sent to the shipped daemon, first flights
//! received by the client.
//!
//! Each case damages valid bytes in a few ways (`damage`). The damage depends only on the seed and the number of the
//! case, so that a case can be repeated alone. A case is accepted, refused with a reason, or a finding: a panic, or
//! work beyond a bound. The daemon runs in a process of its own, whose memory, processor time and panics are counted;
//! for the other subjects they are this process's.

mod damage;
mod exchange;
mod flights;
mod packs;
mod sessions;
mod subject;
mod tally;
mod viewers;
mod wire;

use std::panic::resume_unwind;
use std::path::Path;

pub use flights::Flights;
pub use packs::Packs;
pub use subject::{Settings, Subject};
pub use tally::{MutationOutcome, Verdict};

use crate::plan::Transport;
use crate::process::Process;
use tally::Tally;

/// Runs the cases of one subject. `cache` is the folder of prepared packs, `named` the same if a user named one.
///
/// # Errors
/// A scene, server or client that cannot be set up; systems without `/proc`.
pub fn measure(
    subject: Subject,
    settings: Settings,
    cache: &Path,
    named: Option<&Path>,
) -> anyhow::Result<MutationOutcome> {
    match subject {
        Subject::Packs | Subject::HashedPacks => {
            let packs = Packs::prepare(cache, subject == Subject::HashedPacks)?;
            here(subject, settings, |case| packs.judge(settings.seed, case))
        }
        Subject::Flights => {
            let flights = Flights::record(cache)?;
            here(subject, settings, |case| flights.judge(settings.seed, case))
        }
        Subject::Viewers => viewers::measure(settings, &Flights::record(cache)?),
        Subject::WebSocketSessions => sessions::measure(Transport::Ws, settings, cache, named),
        Subject::QuicSessions => sessions::measure(Transport::Quic, settings, cache, named),
    }
}

/// Runs cases on all processors.
fn here(
    subject: Subject,
    settings: Settings,
    judge: impl Fn(u32) -> anyhow::Result<Verdict> + Sync,
) -> anyhow::Result<MutationOutcome> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let lane = &|cases: Settings, lane: usize| {
        let mut tally = Tally::default();
        for case in cases.cases().skip(lane).step_by(threads) {
            tally.catch(subject, case, || judge(case))?;
        }
        anyhow::Ok(tally)
    };
    let run = |cases: Settings| {
        std::thread::scope(|scope| {
            let lanes: Vec<_> = (0..threads).map(|n| scope.spawn(move || lane(cases, n))).collect();
            let mut all = Tally::default();
            for lane in lanes {
                // Panics of a case are caught there.
                all.merge(&lane.join().unwrap_or_else(|why| resume_unwind(why))?);
            }
            anyhow::Ok(all)
        })
    };
    let process = Process::own();
    let warm = run(settings.warm_up())?;
    let (before_bytes, cpu_before) = (process.memory_bytes()?, process.cpu_s()?);
    let mut tally = run(settings)?;
    tally.add_findings(&warm);
    Ok(tally.found(subject, [before_bytes, process.memory_bytes()?], process.cpu_s()? - cpu_before))
}
