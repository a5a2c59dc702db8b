//! The viewer's streaming thread, with waiting.

use std::sync::mpsc;
use std::time::{Duration, Instant};

use lodestream_client::core::{Change, ClientCore, Config, PartAbsence, StartView};
use lodestream_client::net::{Address, End, Retry, Server};
use lodestream_client::streaming::{Status, Streaming};
use lodestream_protocol::message::Token;
use lodestream_scene::animation::Moment;
use lodestream_scene::parts::{PartInfo, ScenePart};

use super::{LIMIT, PICTURE_PX};

/// A client without graphics: the part of the viewer beside its window.
pub(crate) struct Viewer {
    streaming: Streaming,
    notified: mpsc::Receiver<()>,
    /// All changes for a renderer so far.
    pub(crate) changes: Vec<Change>,
}

/// The viewer's settings for the compared pictures.
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

    /// Waits for a status. Takes all changes meanwhile, as a renderer would.
    pub(crate) fn wait(&mut self, what: &str, mut wanted: impl FnMut(&Status) -> bool) -> Status {
        let until = Instant::now() + LIMIT;
        loop {
            // The status first: a settled status covers the changes taken after it.
            let status = self.streaming.status();
            while let Some(step) = self.streaming.take() {
                self.changes.extend(step);
            }
            if wanted(&status) {
                return status;
            }
            assert!(status.end.is_none(), "streaming ended while waiting for {what}: {:?}", status.end);
            assert!(Instant::now() < until, "{what} did not happen: {status:#?}");
            let _ = self.notified.recv_timeout(Duration::from_millis(100));
        }
    }

    /// What a part is called; waits for the answer.
    pub(crate) fn part(&mut self, instance: u32, part: u32) -> Result<PartInfo, PartAbsence> {
        let id = ScenePart { instance, part };
        assert!(self.streaming.look_up_part(id), "streaming has ended");
        let until = Instant::now() + LIMIT;
        loop {
            if let Some(answer) = self.streaming.take_part() {
                assert_eq!(answer.id, id);
                return answer.info;
            }
            assert!(Instant::now() < until, "no answer for {id:?}");
            let _ = self.notified.recv_timeout(Duration::from_millis(100));
        }
    }

    /// Shows a clip at a time.
    pub(crate) fn animate(&self, moment: Option<Moment>) {
        self.streaming.animate(moment);
    }

    /// Asks the client's core; waits for the answer.
    pub(crate) fn ask<T: Send + 'static>(
        &self,
        question: impl FnOnce(&ClientCore) -> T + Send + 'static,
    ) -> T {
        self.streaming.ask(question).unwrap().wait().unwrap()
    }

    pub(crate) fn settle(&mut self) -> Status {
        self.wait("a settled picture", |status| status.settled)
    }

    /// Presents another token.
    pub(crate) fn show(&self, token: Token) {
        self.streaming.tokens().set(token);
    }

    /// Waits until the streaming thread gives up; returns the user's message.
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
