//! What is handed to the transport, one thing at a time.

use std::sync::Arc;

use super::{Phase, ServerSession, Transmit};
use crate::blob::BlobId;
use crate::frame::encode_server;
use crate::limits::MAX_PIECE_BYTES;
use crate::message::{Refused, ServerMessage};
use crate::scheduler::{Outgoing, Unit};
use crate::source::SourceError;
use crate::time::Time;

impl ServerSession {
    /// The next thing to send, if the limiter admits one now. Call until `None`, and only while the
    /// transport can take it: what is handed over can no longer be overtaken.
    pub fn poll_transmit(&mut self, now: Time) -> Option<Transmit> {
        self.offered = now;
        self.woken = now;
        if let Some(message) = self.control.pop_front() {
            return Some(self.transmit_message(now, message));
        }
        if self.phase == Phase::Closed {
            return None;
        }
        if let Some(id) = self.abandoned.pop_front() {
            return Some(Transmit::Abandon(id));
        }
        if self.replan_at.is_some_and(|at| at <= now) {
            self.replan(now);
        }
        self.refill();
        if let Some(share) = &mut self.share {
            share.set_active(!self.scheduler.is_empty());
            self.bucket.set_rate(Some(share.limit(self.config.limiter.rate_bits_per_s)));
        }
        if self.bucket.admits(now)
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
        if !self.bases_told && self.bases_left.is_empty() {
            self.bases_told = true;
            return Some(self.transmit_message(now, ServerMessage::BasesSent));
        }
        if !self.done_told && self.scheduler.is_empty() && self.push.is_empty() {
            self.done_told = true;
            return Some(self.transmit_message(now, ServerMessage::Done));
        }
        None
    }

    fn transmit_queued(&mut self, now: Time) -> Option<Transmit> {
        let source = Arc::clone(&self.source);
        let longest = self.max_blob_bytes as usize;
        let mut read = |id: &BlobId| {
            let bytes = source.read(id)?;
            if bytes.len() > longest {
                let why = format!("{} bytes are more than the client takes", bytes.len());
                return Err(SourceError::Unreadable { id: *id, why });
            }
            Ok(bytes)
        };
        let piece_bytes = self.config.piece_bytes.clamp(1, MAX_PIECE_BYTES as u32) as usize;
        Some(match self.scheduler.next(piece_bytes, &mut read)? {
            Outgoing::Page(page) => {
                if self.handed.insert(Unit::Page(page), u32::MAX).is_none() {
                    self.pages_handed = self.pages_handed.saturating_add(1);
                }
                self.bases_left.remove(&Unit::Page(page));
                self.done_told = false;
                let Some(page) = self.source.page(page) else { return self.transmit_queued(now) };
                self.transmit_message(now, ServerMessage::ScenePage((*page).clone()))
            }
            Outgoing::Piece { piece, priority } => {
                let handed = self.handed.entry(Unit::Blob(piece.id)).or_insert(0);
                *handed = piece.offset.saturating_add(piece.bytes.len() as u32).max(*handed);
                self.stats.blobs += u64::from(piece.offset == 0);
                if piece.is_last() {
                    self.bases_left.remove(&Unit::Blob(piece.id));
                }
                self.done_told = false;
                self.stats.blob_bytes += piece.bytes.len() as u64;
                self.stats.wire_bytes += self.bucket.spend(now, piece.bytes.len());
                Transmit::Piece { piece, priority }
            }
            Outgoing::Failed { id, reason } => {
                self.bases_left.remove(&Unit::Blob(id));
                self.transmit_message(now, ServerMessage::Refused(Refused { id, reason }))
            }
        })
    }

    /// Control messages are never held back, but what they cost is.
    fn transmit_message(&mut self, now: Time, message: ServerMessage) -> Transmit {
        let bytes = encode_server(&message).map_or(0, |frame| frame.len());
        self.stats.messages += 1;
        self.stats.wire_bytes += self.bucket.spend(now, bytes);
        Transmit::Message(message)
    }
}
