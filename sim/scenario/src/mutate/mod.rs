//! What damaged bytes do to those who read them: packs to whoever serves and decodes them, a client's frames to the
//! shipped daemon, a server's first flight to the client.
//!
//! Each case begins with bytes as we write them and damages them in a few ways (`damage`); what is damaged, and how,
//! follows from a seed and the case's number alone, so that a case can be run again by itself. A case is taken, refused
//! with a reason, or a finding: a panic, or no end within a bound of work. The daemon's memory, processor time and panics
//! are those of a process of its own; the others' are this process's.

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

/// Tries one subject; `cache` is the folder of prepared packs, `named` the same if a user named one.
///
/// # Errors
/// What keeps scene, server or clients from being made, and systems without `/proc`.
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

/// Runs cases on as many threads as there are processors.
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
                // A panic of a case is caught there.
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
