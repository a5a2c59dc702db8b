//! Control messages that wait to be handed over: bounded in bytes, since a client decides how many it causes and how
//! many it takes.

use std::collections::VecDeque;
use std::mem::size_of;

use crate::message::{Close, Refused, ServerMessage};
use lodestream_scene::limits::MAX_IDS_PER_MESSAGE;

/// Most memory that waiting messages may take, in bytes. A peer that causes more is closed. What a client may cause with
/// one message is a third of it at most ([`MAX_IDS_PER_MESSAGE`] refusals).
pub(super) const MAX_WAITING_BYTES: usize = 64 * 1024;

/// There is no room for another message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Full;

/// Small, since there may be thousands: a [`ServerMessage`] is as long as the longest.
#[derive(Debug)]
enum Waiting {
    Pong(u32),
    Refused(Vec<Refused>),
    Other(Box<ServerMessage>),
}

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    queue: VecDeque<Waiting>,
    bytes: usize,
}

impl Waiting {
    fn bytes(&self) -> usize {
        size_of::<Self>()
            + match self {
                Self::Pong(_) => 0,
                Self::Refused(refused) => refused.len() * size_of::<Refused>(),
                Self::Other(_) => size_of::<ServerMessage>(),
            }
    }
}

impl Outbox {
    /// These messages wait, the first first.
    pub(super) fn new(first: impl Iterator<Item = ServerMessage>) -> Self {
        let mut this = Self::default();
        first.for_each(|message| this.append(Waiting::Other(Box::new(message))));
        this
    }

    fn append(&mut self, waiting: Waiting) {
        self.bytes += waiting.bytes();
        self.queue.push_back(waiting);
    }

    fn push(&mut self, waiting: Waiting) -> Result<(), Full> {
        if self.bytes + waiting.bytes() > MAX_WAITING_BYTES {
            return Err(Full);
        }
        self.append(waiting);
        Ok(())
    }

    /// Answers a ping.
    pub(super) fn pong(&mut self, nonce: u32) -> Result<(), Full> {
        self.push(Waiting::Pong(nonce))
    }

    /// Refuses a request. Refusals that wait one behind the other are one message.
    pub(super) fn refuse(&mut self, refused: Refused) -> Result<(), Full> {
        match self.queue.back_mut() {
            Some(Waiting::Refused(last)) if last.len() < MAX_IDS_PER_MESSAGE => {
                if self.bytes + size_of::<Refused>() > MAX_WAITING_BYTES {
                    return Err(Full);
                }
                last.push(refused);
                self.bytes += size_of::<Refused>();
                Ok(())
            }
            _ => self.push(Waiting::Refused(vec![refused])),
        }
    }

    /// Drops all that waits; these are the last words, if any.
    pub(super) fn end(&mut self, close: Option<Close>) {
        *self = Self::default();
        if let Some(close) = close {
            self.append(Waiting::Other(Box::new(ServerMessage::Close(close))));
        }
    }

    /// The next message.
    pub(super) fn pop(&mut self) -> Option<ServerMessage> {
        let next = self.queue.pop_front()?;
        self.bytes -= next.bytes();
        Some(match next {
            Waiting::Pong(nonce) => ServerMessage::Pong(nonce),
            Waiting::Refused(refused) => match refused[..] {
                [one] => ServerMessage::Refused(one),
                _ => ServerMessage::RefusedMany(refused),
            },
            Waiting::Other(message) => *message,
        })
    }

    /// Whether nothing waits.
    pub(super) fn is_empty(&self) -> bool {
        self.queue.is_empty()
    }

    /// Memory that is accounted for what waits, in bytes.
    pub(super) const fn bytes(&self) -> usize {
        self.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::RefusedReason;
    use lodestream_scene::blob::BlobId;

    fn refused(n: u32) -> Refused {
        Refused { id: BlobId::chunk(0, n), reason: RefusedReason::NotFound }
    }

    #[test]
    fn every_bogus_wish_was_a_message_of_its_own() {
        let mut outbox = Outbox::default();
        outbox.refuse(refused(0)).unwrap();
        assert_eq!(outbox.pop(), Some(ServerMessage::Refused(refused(0))));
        for n in 0..1500 {
            outbox.refuse(refused(n)).unwrap();
        }
        outbox.pong(7).unwrap();
        let all: Vec<_> = std::iter::from_fn(|| outbox.pop()).collect();
        let lengths: Vec<_> = all
            .iter()
            .map(|message| match message {
                ServerMessage::RefusedMany(many) => many.len(),
                _ => 1,
            })
            .collect();
        assert_eq!((lengths, outbox.bytes()), (vec![1024, 476, 1], 0));
    }

    #[test]
    fn what_waits_is_bounded_in_bytes() {
        let mut outbox = Outbox::default();
        assert!((0..100_000).any(|n| outbox.refuse(refused(n)).is_err()));
        assert!((0..100_000).any(|n| outbox.pong(n).is_err()) && outbox.bytes() <= MAX_WAITING_BYTES);
        outbox.end(None);
        assert!((0..100_000).any(|n| outbox.pong(n).is_err()) && outbox.bytes() <= MAX_WAITING_BYTES);
        // More than a client causes by one message finds room.
        outbox.end(None);
        assert!((0..2 * MAX_IDS_PER_MESSAGE as u32).all(|n| outbox.refuse(refused(n)).is_ok()));
    }
}
