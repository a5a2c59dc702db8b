//! Blobs that arrived before `Welcome`, which identifies their scene.

use super::downloads::Complete;

/// Most blobs held. A server pushes some tens before `Hello`.
pub(super) const MAX_EARLY: usize = 256;

/// Blobs held until `Welcome`.
#[derive(Debug, Default)]
pub(super) struct Early {
    blobs: Vec<Complete>,
    bytes: u64,
}

impl Early {
    /// Holds a blob.
    ///
    /// # Errors
    /// Returns the blob if there are too many or it would exceed `most_bytes` in all.
    pub(super) fn hold(&mut self, blob: Complete, most_bytes: u64) -> Result<(), Complete> {
        let bytes = self.bytes.saturating_add(blob.bytes.len() as u64);
        if self.blobs.len() >= MAX_EARLY || bytes > most_bytes {
            return Err(blob);
        }
        self.bytes = bytes;
        self.blobs.push(blob);
        Ok(())
    }

    /// Removes all held blobs, in order of arrival.
    pub(super) fn take(&mut self) -> Vec<Complete> {
        self.bytes = 0;
        std::mem::take(&mut self.blobs)
    }

    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.blobs.len()
    }
}
