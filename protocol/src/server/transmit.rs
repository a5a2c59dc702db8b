//! Output of a server session: what the driver passes to the transport, one item at a time.

use std::sync::Arc;

use bytes::Bytes;
use lodestream_geometry::numbers::id32;

use super::session::{Phase, ServerSession};
use crate::frame::{BlobPiece, encode_server};
use crate::message::{CloseCode, Refused, ServerMessage};
use crate::scheduler::{Outgoing, Unit};
use crate::time::Time;
use lodestream_scene::blob::BlobId;
use lodestream_scene::limits::MAX_PIECE_BYTES;
use lodestream_select::priority::{Priority, is_base};

/// An item that the driver passes to the transport.
#[derive(Clone, Debug, PartialEq)]
pub enum Transmit {
    /// A control message.
    Message {
        /// The message, for drivers that count or inspect it.
        message: ServerMessage,
        /// The message encoded as a frame: the bytes to send.
        frame: Bytes,
        /// Priority of a scene page for which no first frame waits. QUIC sends it on a stream of its own: on the control
        /// stream it would overtake base meshes that were handed over before.
        page_priority: Option<Priority>,
    },
    /// A piece of a blob. The pieces of a blob come in order, interleaved with pieces of other blobs.
    Piece {
        /// The piece.
        piece: BlobPiece,
        /// The blob's priority, for the stream ([`crate::stream::quic_priority`]).
        priority: Priority,
    },
    /// The rest of a blob is cancelled: QUIC resets its stream, WebSocket does nothing.
    Abandon(BlobId),
}

impl ServerSession {
    /// The next item to send, if the limiter admits one now. Call until `None`, and only while the transport accepts
    /// data: urgent blobs cannot overtake what was already returned.
    pub fn poll_transmit(&mut self, now: Time) -> Option<Transmit> {
        self.timers.work_offered(now);
        self.timers.driver_polled(now);
        if let Some(message) = self.control.pop() {
            return self.transmit_message(now, message);
        }
        if self.phase == Phase::Closed {
            return None;
        }
        if let Some(id) = self.requests.poll_abandoned() {
            return Some(Transmit::Abandon(id));
        }
        self.push.replan_if_due(now, &*self.source, &mut self.requests);
        let open = self.phase == Phase::Open;
        self.push.refill(&*self.source, &mut self.requests, &self.config, open);
        let active = self.requests.scheduler.has_ready_work();
        if self.pace.admits(now, active)
            && let Some(transmit) = self.transmit_queued(now)
        {
            return Some(transmit);
        }
        self.transmit_milestone(now)
    }

    /// Reports once that all base meshes are sent, and once that everything is.
    fn transmit_milestone(&mut self, now: Time) -> Option<Transmit> {
        if self.phase != Phase::Open {
            return None;
        }
        if self.push.must_report_bases() {
            self.push.bases_reported();
            return self.transmit_message(now, ServerMessage::BasesSent);
        }
        if self.must_report_done() {
            self.done_reported = true;
            return self.transmit_message(now, ServerMessage::Done);
        }
        None
    }

    fn transmit_queued(&mut self, now: Time) -> Option<Transmit> {
        let source = Arc::clone(&self.source);
        let piece_bytes = self.config.piece_bytes.clamp(1, id32(MAX_PIECE_BYTES)) as usize;
        match self.requests.next(&*source, piece_bytes)? {
            Outgoing::Page { page: number, priority } => {
                self.push.settled(Unit::Page(number));
                self.done_reported = false;
                let Some(page) = source.page(number) else { return self.transmit_queued(now) };
                let mut transmit = self.transmit_message(now, ServerMessage::ScenePage((*page).clone()))?;
                if let Transmit::Message { message: ServerMessage::ScenePage(_), page_priority, .. } =
                    &mut transmit
                {
                    *page_priority = Some(priority).filter(|&priority| number > 0 && !is_base(priority));
                }
                Some(transmit)
            }
            Outgoing::Piece { piece, priority } => {
                self.stats.blobs += u64::from(piece.offset == 0);
                if piece.is_last() {
                    self.push.settled(Unit::Blob(piece.id));
                }
                self.done_reported = false;
                self.stats.blob_bytes += piece.bytes.len() as u64;
                self.stats.wire_bytes += self.pace.spend(now, piece.bytes.len());
                Some(Transmit::Piece { piece, priority })
            }
            Outgoing::Failed { id, reason } => {
                self.push.settled(Unit::Blob(id));
                self.transmit_message(now, ServerMessage::Refused(Refused { id, reason }))
            }
        }
    }

    /// Control messages are never delayed by the limiter, but are charged to it.
    fn transmit_message(&mut self, now: Time, message: ServerMessage) -> Option<Transmit> {
        match encode_server(&message) {
            Ok(frame) => {
                self.stats.messages += 1;
                self.stats.wire_bytes += self.pace.spend(now, frame.len());
                Some(Transmit::Message { message, frame: frame.into(), page_priority: None })
            }
            // The scene contains something that does not fit a message; no client can use it.
            Err(why) => {
                self.refuse(CloseCode::Limit, &format!("the server cannot send this scene: {why}"));
                self.poll_transmit(now)
            }
        }
    }
}
