//! Queue of outgoing control messages, bounded in bytes: the client decides how many it causes and how fast it reads
//! them.

use std::collections::VecDeque;
use std::mem::size_of;

use crate::message::{Close, Refused, ServerMessage};
use lodestream_scene::limits::MAX_IDS_PER_MESSAGE;

/// Most memory of queued messages, in bytes. A session that needs more is closed. One message of a client causes at
/// most a third of it ([`MAX_IDS_PER_MESSAGE`] refusals).
pub(super) const MAX_QUEUED_BYTES: usize = 64 * 1024;

/// The queue has no room for another message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Full;

/// A queued message. Smaller than [`ServerMessage`], whose size is that of its largest variant: there may be thousands.
#[derive(Debug)]
enum QueuedMessage {
    Pong(u32),
    Refused(Vec<Refused>),
    Other(Box<ServerMessage>),
}

/// A bounded queue of control messages.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    queue: VecDeque<QueuedMessage>,
    bytes: usize,
}

impl QueuedMessage {
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
    /// A queue of these messages, in order.
    pub(super) fn new(messages: impl Iterator<Item = ServerMessage>) -> Self {
        let mut this = Self::default();
        messages.for_each(|message| this.append(QueuedMessage::Other(Box::new(message))));
        this
    }

    fn append(&mut self, message: QueuedMessage) {
        self.bytes += message.bytes();
        self.queue.push_back(message);
    }

    fn push(&mut self, message: QueuedMessage) -> Result<(), Full> {
        if self.bytes + message.bytes() > MAX_QUEUED_BYTES {
            return Err(Full);
        }
        self.append(message);
        Ok(())
    }

    /// Queues the answer to a ping.
    pub(super) fn pong(&mut self, nonce: u32) -> Result<(), Full> {
        self.push(QueuedMessage::Pong(nonce))
    }

    /// Queues the refusal of a request. Consecutive refusals become one message.
    pub(super) fn refuse(&mut self, refused: Refused) -> Result<(), Full> {
        match self.queue.back_mut() {
            Some(QueuedMessage::Refused(last)) if last.len() < MAX_IDS_PER_MESSAGE => {
                if self.bytes + size_of::<Refused>() > MAX_QUEUED_BYTES {
                    return Err(Full);
                }
                last.push(refused);
                self.bytes += size_of::<Refused>();
                Ok(())
            }
            _ => self.push(QueuedMessage::Refused(vec![refused])),
        }
    }

    /// Drops all queued messages; `close` is the last one, if given.
    pub(super) fn end(&mut self, close: Option<Close>) {
        *self = Self::default();
        if let Some(close) = close {
            self.append(QueuedMessage::Other(Box::new(ServerMessage::Close(close))));
        }
    }

    /// Takes the next message.
    pub(super) fn pop(&mut self) -> Option<ServerMessage> {
        let next = self.queue.pop_front()?;
        self.bytes -= next.bytes();
        Some(match next {
            QueuedMessage::Pong(nonce) => ServerMessage::Pong(nonce),
            QueuedMessage::Refused(refused) => match refused[..] {
                [one] => ServerMessage::Refused(one),
                _ => ServerMessage::RefusedMany(refused),
            },
            QueuedMessage::Other(message) => *message,
        })
    }

    /// Whether the queue is empty.
    pub(super) fn is_empty(&self) -> bool {
        self.queue.is_empty()
    }

    /// Accounted memory of the queued messages, in bytes.
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
    fn refusals_are_merged_into_one_message() {
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
    fn queue_is_bounded_in_bytes() {
        let mut outbox = Outbox::default();
        assert!((0..100_000).any(|n| outbox.refuse(refused(n)).is_err()));
        assert!((0..100_000).any(|n| outbox.pong(n).is_err()) && outbox.bytes() <= MAX_QUEUED_BYTES);
        outbox.end(None);
        assert!((0..100_000).any(|n| outbox.pong(n).is_err()) && outbox.bytes() <= MAX_QUEUED_BYTES);
        // Twice as many refusals as one client message can cause fit.
        outbox.end(None);
        assert!((0..2 * MAX_IDS_PER_MESSAGE as u32).all(|n| outbox.refuse(refused(n)).is_ok()));
    }
}
