//! The worker's half: the client's core behind calls that a script can make. The script owns the transport.

use lodestream_client::core::{ClientCore, Config, Progress, StartView};
use lodestream_protocol::frame::encode_client;
use lodestream_protocol::message::{CloseCode, Token};
#[cfg(feature = "viewer")]
use lodestream_scene::animation::Moment;
use lodestream_scene::encoding;
use lodestream_scene::view::View;
use wasm_bindgen::prelude::*;

use crate::pictures::{Picture, Pictures};
use crate::streams::{Arrival, Streams, message};
use crate::{stats, steps, time};

/// Payload bytes decoded in one turn: about 10 ms of work, so that frames and views are not kept waiting.
pub(crate) const SLICE_BYTES: u64 = 16 * 1024;
/// Bytes of changes in one step: about one frame's uploads.
pub(crate) const STEP_BYTES: usize = 512 << 10;
/// Memory that a decoded view may take on the heap: it takes none.
const VIEW_HEAP_BYTES: usize = 0;

/// Session, cache, selection and refinement.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Streamer {
    pub(crate) core: ClientCore,
    /// Streams of a WebTransport session.
    streams: Streams,
    /// Texture levels that the script decodes.
    pictures: Pictures,
    /// Those of the last step that it has not taken.
    to_decode: Vec<Picture>,
    /// Transport payload of this connection.
    received_bytes: u64,
    /// Connect call of the first connection.
    begun_ms: f64,
    /// Payload bytes decoded in one turn.
    pub(crate) slice_bytes: u64,
    /// Decoders whose workers are not all there yet.
    #[cfg(feature = "threads")]
    pub(crate) decoders: Option<lodestream_client::core::Decoders>,
}

#[wasm_bindgen]
impl Streamer {
    /// A streamer for a picture of a size in pixels, refined to a screen error of `target_px`. An empty scene name means
    /// the server's default, an empty token none. `memory_bytes` bounds the memory of streamer and viewer, `cache_bytes` received blobs that
    /// are kept.
    #[wasm_bindgen(constructor)]
    #[must_use]
    pub fn new(
        width: u32,
        height: u32,
        target_px: f32,
        scene: String,
        token: String,
        memory_bytes: Option<f64>,
        cache_bytes: Option<f64>,
    ) -> Self {
        let start = StartView::OfScene { viewport_px: [width.max(1), height.max(1)], target_px };
        let mut config = Config::new(start);
        config.session.scene = scene;
        config.session.token = (!token.is_empty()).then_some(Token(token));
        config.max_waiting_bytes = 8 << 20;
        // JavaScript numbers; negative ones saturate to zero.
        if let Some(bytes) = memory_bytes {
            config.bound_memory(bytes as u64);
        }
        if let Some(bytes) = cache_bytes {
            config.cache_bytes = bytes as u64;
        }
        // Pages that draw by other means take texels.
        config.host_decodes_textures = !cfg!(feature = "deltas");
        // Their meshes have no parts that could be left out.
        config.select.partial_proxies = !cfg!(feature = "deltas");
        Self {
            core: ClientCore::new(config),
            streams: Streams::default(),
            pictures: Pictures::default(),
            to_decode: Vec::new(),
            received_bytes: 0,
            begun_ms: 0.0,
            slice_bytes: SLICE_BYTES,
            #[cfg(feature = "threads")]
            decoders: None,
        }
    }

    /// Records the connect call, from which milestones count.
    pub fn begin(&mut self, now_ms: f64) {
        self.core.begin(time(now_ms));
        self.begun_ms = now_ms;
    }

    /// Begins a session over a transport that is open.
    pub fn connect(&mut self, now_ms: f64) {
        self.received_bytes = 0;
        self.streams = Streams::default();
        self.core.connect(time(now_ms));
    }

    /// Takes a frame, as one message of a WebSocket carries it.
    pub fn receive(&mut self, now_ms: f64, frame: Vec<u8>) {
        self.count(frame.len());
        let now = time(now_ms);
        match message(frame) {
            Ok(Some(frame)) => self.core.handle_frame(now, frame),
            // Of a later version: skipped.
            Ok(None) => {}
            Err(why) => self.core.handle_frame_error(now, &why),
        }
    }

    /// Takes bytes of one of the server's streams, as a WebTransport session carries them.
    pub fn receive_stream(&mut self, now_ms: f64, stream: u32, bytes: Vec<u8>) {
        self.count(bytes.len());
        let now = time(now_ms);
        match self.streams.push(stream, bytes.into()) {
            Ok(arrivals) => {
                for arrival in arrivals {
                    match arrival {
                        Arrival::Frame(frame) => self.core.handle_frame(now, frame),
                        Arrival::Piece(piece) => self.core.handle_piece(now, piece),
                    }
                }
            }
            Err(why) => self.core.handle_frame_error(now, &why),
        }
    }

    /// Takes the end of a stream.
    pub fn end_stream(&mut self, now_ms: f64, stream: u32) {
        if let Err(why) = self.streams.end(stream) {
            self.core.handle_frame_error(time(now_ms), &why);
        }
    }

    /// Takes the reset of a stream: its blob was cancelled.
    pub fn reset_stream(&mut self, now_ms: f64, stream: u32) {
        if let Some(id) = self.streams.reset(stream) {
            self.core.handle_abandoned(time(now_ms), id);
        }
    }

    pub(crate) fn count(&mut self, bytes: usize) {
        self.received_bytes += bytes as u64;
        self.core.note_transport_bytes(self.received_bytes);
    }

    /// Records that the transport was lost.
    pub fn lost(&mut self, now_ms: f64, reason: &str) {
        self.core.handle_lost(time(now_ms), reason);
    }

    /// Ends the session normally.
    pub fn leave(&mut self, now_ms: f64) {
        self.core.leave(time(now_ms));
    }

    /// Selects, decodes and applies for some milliseconds; whether more is to be done at once.
    pub fn turn(&mut self, now_ms: f64) -> bool {
        self.core.handle_timeout(time(now_ms));
        self.core.update(time(now_ms), self.slice_bytes) == Progress::More
    }

    /// The next frame to send.
    ///
    /// # Errors
    /// A fault of the core.
    pub fn transmit(&mut self, now_ms: f64) -> Result<Option<Vec<u8>>, String> {
        let message = self.core.poll_transmit(time(now_ms));
        message.map(|message| encode_client(&message).map_err(|why| why.to_string())).transpose()
    }

    /// The pictures of the last step, to decode before it goes to the page: objects with `number`, `uses`, `file`
    /// (`Uint8Array`), `width`, `height`, `height_map` and `planes`.
    #[must_use]
    pub fn pictures(&mut self) -> js_sys::Array {
        std::mem::take(&mut self.to_decode).iter().map(stats::picture).collect()
    }

    /// The texels of a picture with `planes`, from its pixels.
    #[must_use]
    pub fn texels(&self, number: u32, pixels: &[u8]) -> Vec<u8> {
        self.pictures.texels(number, pixels)
    }

    /// Takes the result for a picture: none, or why it cannot be decoded. It then counts as damaged and may be
    /// requested again.
    pub fn decoded(&mut self, now_ms: f64, number: u32, failure: Option<String>) {
        let level = self.pictures.report(number);
        if let (Some((asset, texture, level, tile)), Some(why)) = (level, failure) {
            self.core.handle_texture_failure(time(now_ms), (asset, texture), (level, tile), why);
        }
    }

    /// The next step of changes for the page; see [`Streamer::pictures`].
    ///
    /// # Errors
    /// A fault of the core.
    pub fn step(&mut self, now_ms: f64) -> Result<Option<Vec<u8>>, String> {
        if !self.core.has_changes() {
            return Ok(None);
        }
        let mut step = self.core.take_changes(time(now_ms), STEP_BYTES);
        self.to_decode.extend(self.pictures.take(&mut step));
        steps::encode(&step).map(Some).map_err(|why| why.to_string())
    }

    /// Lets the next steps give the whole scene again, for a page that has lost its graphics device.
    pub fn restate(&mut self, now_ms: f64) {
        self.core.restate(time(now_ms));
    }

    /// Sets the view from the bytes that the page's viewer gives.
    ///
    /// # Errors
    /// Other bytes.
    pub fn set_view(&mut self, now_ms: f64, view: &[u8]) -> Result<(), String> {
        let view: View = encoding::decode(view, VIEW_HEAP_BYTES).map_err(|why| format!("view: {why}"))?;
        view.check().map_err(|why| format!("view: {why}"))?;
        self.core.set_view(time(now_ms), view);
        Ok(())
    }

    /// Sets which clip animated instances are in, and at what time in seconds, for picking and refinement.
    #[cfg(feature = "viewer")]
    pub fn animate(&mut self, clip: String, time_s: f64) {
        self.core.animate(Some(Moment { clip, time_s }));
    }

    /// Whether objects out of view that cast shadows into it are refined too.
    pub fn set_shadows(&mut self, shadows: bool) {
        self.core.set_shadows(shadows);
    }

    /// Bounds the memory of streamer and viewer from now on: the viewer's render targets may leave less, or more.
    pub fn bound_memory(&mut self, memory_bytes: f64) {
        self.core.bound_memory(memory_bytes as u64);
    }

    /// Sets a newer token.
    pub fn set_token(&mut self, token: &str) {
        self.core.set_token(Token(token.to_owned()));
    }

    /// Time of the next [`Streamer::turn`] without an event.
    #[must_use]
    pub fn timeout_ms(&self) -> Option<f64> {
        self.core.poll_timeout().map(|at| std::time::Duration::from(at).as_secs_f64() * 1e3)
    }

    /// Whether anything of a scene has arrived.
    #[must_use]
    pub fn has_scene(&self) -> bool {
        self.core.scene().is_some()
    }

    /// Why the session ended, once it has.
    #[must_use]
    pub fn closed(&self) -> Option<String> {
        self.core.closed().map(|close| close.reason.clone())
    }

    /// Whether it ended for a reason that another attempt may not have.
    #[must_use]
    pub fn may_retry(&self) -> bool {
        let transient = [CloseCode::Lost, CloseCode::ShuttingDown, CloseCode::Busy, CloseCode::Timeout];
        self.core.closed().is_none_or(|close| transient.contains(&close.code))
    }

    /// Whether the picture is settled and the page has all of it; costs less than [`Streamer::stats`].
    #[must_use]
    pub fn is_settled(&self) -> bool {
        self.core.is_settled() && !self.waits()
    }

    /// The viewer's figures as an object. Costs a pass over the assets.
    #[must_use]
    pub fn stats(&self) -> js_sys::Object {
        stats::object(&self.core.stats(), self.waits(), self.begun_ms)
    }

    /// Whether the page lacks changes.
    fn waits(&self) -> bool {
        self.core.has_changes() || self.pictures.is_decoding()
    }
}
