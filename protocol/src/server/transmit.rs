//! What is handed to the transport, one thing at a time.

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
use lodestream_select::Priority;

/// What the driver should hand to the transport.
#[derive(Clone, Debug, PartialEq)]
pub enum Transmit {
    /// A control message.
    Message {
        /// What it says, for drivers that count or look.
        message: ServerMessage,
        /// The same as a frame: the bytes to send.
        frame: Bytes,
    },
    /// A piece of a blob. Pieces of a blob come in order; pieces of others may come between.
    Piece {
        /// The piece.
        piece: BlobPiece,
        /// The blob's priority, for the stream ([`crate::stream::quic_priority`]).
        priority: Priority,
    },
    /// The rest of a blob will not come: reset its stream. Nothing to do on WebSocket.
    Abandon(BlobId),
}

impl ServerSession {
    /// The next thing to send, if the limiter admits one now. Call until `None`, and only while the
    /// transport can take it: what is handed over can no longer be overtaken.
    pub fn poll_transmit(&mut self, now: Time) -> Option<Transmit> {
        self.timers.offered(now);
        self.timers.woken(now);
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
        let active = self.requests.scheduler.can_go_on();
        if self.pace.admits(now, active)
            && let Some(transmit) = self.transmit_queued(now)
        {
            return Some(transmit);
        }
        self.tell_milestones(now)
    }

    /// Says that all base meshes are sent, or everything, once each.
    fn tell_milestones(&mut self, now: Time) -> Option<Transmit> {
        if self.phase != Phase::Open {
            return None;
        }
        if self.push.bases_to_tell() {
            self.push.tell_bases();
            return self.transmit_message(now, ServerMessage::BasesSent);
        }
        if self.is_done_to_tell() {
            self.done_told = true;
            return self.transmit_message(now, ServerMessage::Done);
        }
        None
    }

    fn transmit_queued(&mut self, now: Time) -> Option<Transmit> {
        let source = Arc::clone(&self.source);
        let piece_bytes = self.config.piece_bytes.clamp(1, id32(MAX_PIECE_BYTES)) as usize;
        match self.requests.next(&*source, piece_bytes)? {
            Outgoing::Page(page) => {
                self.push.settled(Unit::Page(page));
                self.done_told = false;
                let Some(page) = source.page(page) else { return self.transmit_queued(now) };
                self.transmit_message(now, ServerMessage::ScenePage((*page).clone()))
            }
            Outgoing::Piece { piece, priority } => {
                self.stats.blobs += u64::from(piece.offset == 0);
                if piece.is_last() {
                    self.push.settled(Unit::Blob(piece.id));
                }
                self.done_told = false;
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

    /// Control messages are never held back, but what they cost is.
    fn transmit_message(&mut self, now: Time, message: ServerMessage) -> Option<Transmit> {
        match encode_server(&message) {
            Ok(frame) => {
                self.stats.messages += 1;
                self.stats.wire_bytes += self.pace.spend(now, frame.len());
                Some(Transmit::Message { message, frame: frame.into() })
            }
            // The scene holds what cannot be sent; the client cannot help it, nor go on.
            Err(why) => {
                self.refuse(CloseCode::Limit, &format!("the server cannot send this scene: {why}"));
                self.poll_transmit(now)
            }
        }
    }
}
