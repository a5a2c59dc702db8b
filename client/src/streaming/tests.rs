//! What the streaming thread says, in virtual time.

use std::cell::Cell;

use lodestream_protocol::frame::ServerFrame;
use lodestream_protocol::message::{ClientMessage, ServerMessage};

use super::*;
use crate::core::testing::{Loopback, TestScene};

/// The host of a session that is settled, and what a viewer hears of it.
fn settled<N: Fn()>(notify: N) -> (StreamHost<N>, watch::Receiver<Status>, Time) {
    let mut link = Loopback::new(TestScene::new(1), |_| {});
    link.connect();
    link.settle();
    // The handle is gone, which only makes the host leave where somebody asks.
    let (_, controls) = watch::channel(Controls::default());
    let (_, tokens) = watch::channel(None);
    let (sender, status) = watch::channel(Status::default());
    let host = StreamHost {
        core: link.core,
        controls,
        tokens,
        // Nobody draws.
        steps: None,
        status: sender,
        message: None,
        reported: None,
        notify,
        left: false,
    };
    (host, status, link.now)
}

/// Turns the host for so many milliseconds; gives the numbers of the pings that it sends.
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
fn a_server_that_falls_silent_is_told_in_words_within_two_seconds_and_no_longer_once_it_answers() {
    let notified = Cell::new(0);
    let (mut host, status, mut now) = settled(|| notified.set(notified.get() + 1));
    let message = || status.borrow().message.clone();
    // It answers within 20 ms, for three seconds.
    let mut heard = now;
    for _ in 0..150 {
        let pings = turn(&mut host, &mut now, 20);
        if !pings.is_empty() {
            answer(&mut host, now, &pings);
            heard = now;
        }
        assert_eq!(message(), None, "all is well");
    }
    // From now on it says nothing.
    let mut unanswered = Vec::new();
    while message().is_none() {
        unanswered.extend(turn(&mut host, &mut now, 1));
        assert!(now.since(heard) <= Duration::from_secs(2), "nothing is said after {:?}", now.since(heard));
    }
    assert!(now.since(heard) >= Duration::from_secs(1), "said after {:?} already", now.since(heard));
    assert_eq!(message().as_deref(), Some("the server does not answer; waiting for it"));
    // It stays, however often the thread reports.
    unanswered.extend(turn(&mut host, &mut now, 500));
    assert!(message().is_some());
    // It was only slow.
    let before = notified.get();
    answer(&mut host, now, &unanswered);
    turn(&mut host, &mut now, 1);
    assert_eq!(message(), None);
    assert!(notified.get() > before, "whoever shows it is told at once");
}
