//! The loop that drives a core over range requests.

use std::collections::BTreeMap;

use lodestream_protocol::message::Close;
use lodestream_protocol::time::Time;
use lodestream_transport::Clock;
use tokio::sync::mpsc;
use tokio::task::AbortHandle;

use super::{Fetch, Report};
use crate::core::{ClientCore, Progress};
use crate::net::drive::Host;

/// Reports that wait for the core; further ones wait in their connections.
const MAX_REPORTS: usize = 64;

/// Reads a published scene until the session ends; gives the reason.
pub async fn run_published<H: Host>(mut fetch: impl Fetch, host: &mut H, clock: Clock) -> Close {
    host.core().connect_ranges(clock.now());
    let (reports, mut arriving) = mpsc::channel(MAX_REPORTS);
    let mut running = Running::default();
    loop {
        let now = clock.now();
        host.core().note_transport_bytes(fetch.received_bytes());
        host.core().handle_timeout(now);
        let progress = host.turn(now);
        if host.wants_to_leave() {
            host.core().leave(now);
        }
        let core = host.core();
        while let Some(id) = core.poll_cancelled() {
            running.abort(id);
        }
        while let Some(request) = core.poll_request(now) {
            running.0.insert(request.id, fetch.start(request, reports.clone()));
        }
        if let Some(close) = core.closed() {
            return close.clone();
        }
        let deadline = core.poll_timeout();
        let again = progress == Progress::More;
        tokio::select! {
            biased;
            Some((id, report)) = arriving.recv() => {
                running.report(host.core(), clock.now(), id, report);
                for _ in 1..MAX_REPORTS {
                    let Ok((id, report)) = arriving.try_recv() else { break };
                    running.report(host.core(), clock.now(), id, report);
                }
            }
            () = tokio::task::yield_now(), if again => {}
            () = clock.sleep_until(deadline.unwrap_or(now)), if deadline.is_some() => {}
            () = host.wake() => {}
        }
    }
}

/// Requests that have not ended; dropping them aborts them.
#[derive(Default)]
struct Running(BTreeMap<u64, AbortHandle>);

impl Running {
    fn abort(&mut self, id: u64) {
        if let Some(request) = self.0.remove(&id) {
            request.abort();
        }
    }

    fn report(&mut self, core: &mut ClientCore, now: Time, id: u64, report: Report) {
        match report {
            Report::Head(head) => core.handle_response_head(now, id, &head),
            Report::Body(bytes) => core.handle_response_body(now, id, &bytes),
            Report::End => {
                self.0.remove(&id);
                core.handle_response_end(now, id);
            }
            Report::Failed(why) => {
                self.0.remove(&id);
                core.handle_request_failure(now, id, &why);
            }
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.0.values().for_each(AbortHandle::abort);
    }
}
