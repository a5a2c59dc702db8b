//! The loop that drives a core over range requests.

use lodestream_protocol::message::Close;
use lodestream_protocol::time::Time;
use lodestream_transport::Clock;
use tokio::sync::mpsc;

use super::{Fetch, Report};
use crate::core::{ClientCore, Progress};
use crate::net::drive::Host;

/// Reports that wait for the core; further ones wait in their connections.
const MAX_REPORTS: usize = 64;

/// Reads a published scene until the session ends; gives the reason.
pub async fn run_published<H: Host>(mut fetch: impl Fetch, host: &mut H, clock: Clock) -> Close {
    host.core().connect_ranges(clock.now());
    let (reports, mut arriving) = mpsc::channel(MAX_REPORTS);
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
            fetch.abort(id);
        }
        while let Some(request) = core.poll_request(now) {
            fetch.start(request, reports.clone());
        }
        if let Some(close) = core.closed() {
            return close.clone();
        }
        let deadline = core.poll_timeout();
        let again = progress == Progress::More;
        tokio::select! {
            biased;
            Some((id, one)) = arriving.recv() => {
                report(&mut fetch, host.core(), clock.now(), id, one);
                for _ in 1..MAX_REPORTS {
                    let Ok((id, one)) = arriving.try_recv() else { break };
                    report(&mut fetch, host.core(), clock.now(), id, one);
                }
            }
            () = tokio::task::yield_now(), if again => {}
            () = clock.sleep_until(deadline.unwrap_or(now)), if deadline.is_some() => {}
            () = host.wake() => {}
        }
    }
}

fn report(fetch: &mut impl Fetch, core: &mut ClientCore, now: Time, id: u64, report: Report) {
    match report {
        Report::Head(head) => core.handle_response_head(now, id, &head),
        Report::Body(bytes) => core.handle_response_body(now, id, &bytes),
        Report::End => {
            fetch.ended(id);
            core.handle_response_end(now, id);
        }
        Report::Failed(why) => {
            fetch.ended(id);
            core.handle_request_failure(now, id, &why);
        }
        Report::Refused(why) => {
            fetch.ended(id);
            core.handle_request_refusal(now, id, &why);
        }
    }
}
