//! Status messages of the streaming thread, in virtual time.

use std::cell::Cell;

use lodestream_protocol::frame::ServerFrame;
use lodestream_protocol::message::{ClientMessage, ServerMessage};

use super::*;
use crate::core::testing::{Loopback, TestScene};

/// The host of a settled session, and its status channel.
fn settled<N: Fn()>(notify: N) -> (StreamHost<N>, watch::Receiver<Status>, Time) {
    let mut link = Loopback::new(TestScene::new(1), |_| {});
    link.connect();
    link.settle();
    // The senders are dropped, which makes the host leave, but `turn` does not act on that.
    let (_, controls) = watch::channel(Controls::default());
    let (_, tokens) = watch::channel(None);
    let (sender, status) = watch::channel(Status::default());
    let (_, pinned) = watch::channel(Vec::new());
    let (_, moved) = watch::channel(MovedParts::new());
    let (_, moment) = watch::channel(None);
    let host = StreamHost {
        pinned,
        moved,
        moment,
        core: link.core,
        controls,
        tokens,
        questions: questions::channel().1,
        // There is no renderer.
        steps: None,
        lookups: mpsc::channel(1).1,
        next_lookup: None,
        parts: mpsc::channel(1).0,
        status: sender,
        message: None,
        reported_at: None,
        notify,
        leaves: false,
    };
    (host, status, link.now)
}

/// Runs the host for some milliseconds; returns the numbers of the pings that it sends.
fn turn<N: Fn()>(host: &mut StreamHost<N>, now: &mut Time, ms: u64) -> Vec<u32> {
    let mut pings = Vec::new();
    for _ in 0..ms {
        *now = *now + Duration::from_millis(1);
        host.core.handle_timeout(*now);
        host.turn(*now);
        while let Some(message) = host.core.poll_transmit(*now) {
            if let ClientMessage::Ping(number) = message {
                pings.push(number);
            }
        }
    }
    pings
}

fn answer<N: Fn()>(host: &mut StreamHost<N>, now: Time, pings: &[u32]) {
    for &number in pings {
        host.core.handle_frame(now, ServerFrame::Message(ServerMessage::Pong(number)));
    }
}

#[test]
fn a_silent_server_is_reported_within_two_seconds_until_it_answers() {
    let notified = Cell::new(0);
    let (mut host, status, mut now) = settled(|| notified.set(notified.get() + 1));
    let message = || status.borrow().message.clone();
    // The server answers within 20 ms, for three seconds.
    let mut answered_at = now;
    for _ in 0..150 {
        let pings = turn(&mut host, &mut now, 20);
        if !pings.is_empty() {
            answer(&mut host, now, &pings);
            answered_at = now;
        }
        assert_eq!(message(), None, "all is well");
    }
    // From now on the server is silent.
    let mut unanswered = Vec::new();
    while message().is_none() {
        unanswered.extend(turn(&mut host, &mut now, 1));
        assert!(
            now.since(answered_at) <= Duration::from_secs(2),
            "no message after {:?}",
            now.since(answered_at)
        );
    }
    assert!(
        now.since(answered_at) >= Duration::from_secs(1),
        "reported after {:?} already",
        now.since(answered_at)
    );
    assert_eq!(message().as_deref(), Some("the server does not answer; waiting for it"));
    // The message stays while the thread keeps reporting.
    unanswered.extend(turn(&mut host, &mut now, 500));
    assert!(message().is_some());
    // The late answers arrive.
    let before = notified.get();
    answer(&mut host, now, &unanswered);
    turn(&mut host, &mut now, 1);
    assert_eq!(message(), None);
    assert!(notified.get() > before, "the change is notified at once");
}
