//! Blobs that overtook `Welcome`: only it tells what scene they are of.

use super::downloads::Complete;

/// Most blobs held. A server pushes some tens before it hears `Hello`.
pub(super) const MAX_EARLY: usize = 256;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Early {
    blobs: Vec<Complete>,
    bytes: u64,
}

impl Early {
    /// Holds a blob, unless that would be more than `most_bytes` in all: then it comes back.
    pub(super) fn hold(&mut self, blob: Complete, most_bytes: u64) -> Result<(), Complete> {
        let bytes = self.bytes.saturating_add(blob.bytes.len() as u64);
        if self.blobs.len() >= MAX_EARLY || bytes > most_bytes {
            return Err(blob);
        }
        self.bytes = bytes;
        self.blobs.push(blob);
        Ok(())
    }

    /// All that is held, in the order in which it came.
    pub(super) fn take(&mut self) -> Vec<Complete> {
        self.bytes = 0;
        std::mem::take(&mut self.blobs)
    }

    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.blobs.len()
    }
}
