//! What a window's scene comes from: streams, files that are prepared, and the scene that replaces another.

use std::path::PathBuf;
use std::time::Duration;

use lodestream_client::net::{Address, Retry};
use lodestream_client::streaming::{Status, Streaming};
use lodestream_render::{MAX_WAITING_STEPS, SceneView};
use winit::event_loop::EventLoopProxy;

use crate::args::Args;
use crate::local::{LocalOptions, Preparation, Target};
use crate::run::{core_config, server};
use crate::token;
use crate::window::event::Event;

/// Longest time that a scene with all base meshes waits until it is as fine as wanted before it is shown: with a moving
/// camera it may never be.
const MAX_REFINEMENT: Duration = Duration::from_secs(3);

/// Wakes the window from other threads.
#[derive(Clone)]
pub(super) struct Notify(EventLoopProxy<Event>);

impl Notify {
    pub(super) const fn new(proxy: EventLoopProxy<Event>) -> Self {
        Self(proxy)
    }

    /// The call that wakes it.
    pub(super) fn call(&self) -> impl Fn() + Clone + Send + use<> {
        let proxy = self.0.clone();
        move || {
            // Fails only once the window is gone.
            let _ = proxy.send_event(Event::Streaming);
        }
    }
}

/// A scene that is streamed and uploaded, but not drawn yet.
pub(super) struct NextScene {
    pub(super) streaming: Streaming,
    pub(super) scene: SceneView,
    pub(super) status: Status,
    /// When it had all base meshes.
    pub(super) whole: Option<Duration>,
}

impl NextScene {
    /// Whether it can replace what is drawn.
    pub(super) fn is_ready(&self, now: Duration) -> bool {
        let refined = self.status.settled && self.scene.waiting() == 0;
        let waited = self.whole.is_some_and(|since| now >= since + MAX_REFINEMENT);
        let stopped = self.status.stats.lacking_blobs > 0 || self.status.end.is_some();
        self.whole.is_some() && (refined || waited) || stopped
    }
}

/// Files that are prepared to replace what is shown.
pub(super) struct Opening {
    pub(super) target: Target,
    pub(super) files: Preparation,
}

/// The window's title.
pub(super) fn title(target: Option<&Target>) -> String {
    target.map_or_else(|| "Lodestream".into(), |target| format!("Lodestream – {target}"))
}

/// Starts to stream from an address.
pub(super) fn stream(args: &Args, address: &Address, notify: &Notify) -> anyhow::Result<Streaming> {
    let streaming =
        Streaming::start(server(args, address)?, core_config(args)?, Retry::default(), notify.call())?;
    token::follow(args.token_file.as_ref(), &streaming)?;
    Ok(streaming)
}

/// Starts to prepare files.
pub(super) fn prepare(args: &Args, files: &[PathBuf], notify: &Notify) -> anyhow::Result<Preparation> {
    let options = LocalOptions {
        cache: args.cache.clone(),
        coarse_first: true,
        watch: args.watch,
        up: args.up,
        share: args.share,
        quiet: true,
    };
    Preparation::start(files.to_vec(), options, notify.call())
}

/// Takes steps from the streaming thread; returns whether there were any.
pub(super) fn take_steps(streaming: &mut Streaming, scene: &mut SceneView) -> bool {
    let mut any = false;
    while scene.waiting() < MAX_WAITING_STEPS
        && let Some(step) = streaming.take()
    {
        scene.push(step);
        any = true;
    }
    any
}
