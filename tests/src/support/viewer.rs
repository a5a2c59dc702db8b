//! The viewer's streaming thread, waited for.

use std::sync::mpsc;
use std::time::{Duration, Instant};

use lodestream_client::core::{Change, Config, StartView};
use lodestream_client::net::{Address, End, Retry, Server};
use lodestream_client::streaming::{Status, Streaming};
use lodestream_protocol::message::Token;

use super::{LIMIT, PICTURE_PX};

/// A client without graphics: what the viewer runs beside its window.
pub(crate) struct Viewer {
    streaming: Streaming,
    notified: mpsc::Receiver<()>,
    /// Everything that a renderer would have been told so far.
    pub(crate) changes: Vec<Change>,
}

/// The viewer's settings for the pictures that are compared.
pub(crate) fn config() -> Config {
    Config::new(StartView::OfScene { viewport_px: PICTURE_PX, target_px: 1.0 })
}

impl Viewer {
    pub(crate) fn start(address: &Address, config: Config) -> Self {
        Self::start_at(address.clone().into(), config)
    }

    pub(crate) fn start_at(server: Server, config: Config) -> Self {
        let (sender, notified) = mpsc::sync_channel(1);
        let retry = Retry { first_attempts: 3, first_within: Duration::MAX, reconnect: true };
        let streaming = Streaming::start(server, config, retry, move || {
            let _ = sender.try_send(());
        });
        Self { streaming: streaming.unwrap(), notified, changes: Vec::new() }
    }

    /// Waits until a status is as wanted. Takes all changes meanwhile, as a renderer would.
    pub(crate) fn wait(&mut self, what: &str, mut wanted: impl FnMut(&Status) -> bool) -> Status {
        let until = Instant::now() + LIMIT;
        loop {
            // The status first: what it says is settled lies in the changes taken after it.
            let status = self.streaming.status();
            while let Some(step) = self.streaming.take() {
                self.changes.extend(step);
            }
            if wanted(&status) {
                return status;
            }
            assert!(status.end.is_none(), "{what} was waited for, but: {:?}", status.end);
            assert!(Instant::now() < until, "{what} was waited for in vain: {status:#?}");
            let _ = self.notified.recv_timeout(Duration::from_millis(100));
        }
    }

    pub(crate) fn settle(&mut self) -> Status {
        self.wait("a settled picture", |status| status.settled)
    }

    /// Shows another token.
    pub(crate) fn show(&self, token: Token) {
        self.streaming.tokens().set(token);
    }

    /// Waits until the streaming thread gives up; gives what the user is told.
    pub(crate) fn end(&mut self, limit: Duration) -> String {
        let until = Instant::now() + limit;
        loop {
            match self.streaming.status().end {
                Some(End::Closed(close)) => return close.reason,
                Some(End::Unreachable { why, .. }) => return why,
                Some(End::Left) => return "left".into(),
                None => assert!(Instant::now() < until, "{:?}", self.streaming.status()),
            }
            let _ = self.notified.recv_timeout(Duration::from_millis(100));
        }
    }
}
