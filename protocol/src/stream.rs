//! How messages and blobs map onto the two transports.
//!
//! **QUIC** (ALPN [`ALPN`]). The client opens one unidirectional stream for its frames. The server opens
//! one unidirectional stream for its control frames and one for each blob, so that a lost packet delays
//! one blob only and a cancelled blob's stream can be reset. A stream's first byte says which kind it is
//! ([`CONTROL_STREAM`], [`BLOB_STREAM`]); a blob's stream goes on with [`blob_head`] and the blob's bytes,
//! and ends. Stream priorities follow [`quic_priority`].
//!
//! **WebSocket** (subprotocol [`ALPN`]). Each binary message is one [`crate::frame::Frame`]; blobs travel
//! as pieces of a few KiB so that an urgent one does not wait behind a large one. Text messages are
//! refused.

use bytes::Bytes;

use crate::blob::BlobId;
use crate::coding::{CodingError, decode_message, encode_message};
use crate::frame::{BlobPiece, FrameError};
use crate::limits::{MAX_BLOB_BYTES, MAX_PIECE_BYTES};

/// Name of the protocol in TLS ALPN and as WebSocket subprotocol.
pub const ALPN: &str = "lodestream/1";
/// First byte of a stream of control frames, in both directions.
pub const CONTROL_STREAM: u8 = 0;
/// First byte of a stream that carries one blob.
pub const BLOB_STREAM: u8 = 1;
/// Longest head of a blob's stream: kind, length of the head, id and length.
pub const MAX_BLOB_HEAD_BYTES: usize = 1 + 1 + 11 + 5;

/// Stream priority for quinn (higher first) of a blob of the given priority. Control streams should be
/// above all of these: `i32::MAX`.
#[must_use]
pub fn quic_priority(priority: u32) -> i32 {
    // Half the range, so that the order is kept and i32::MAX stays free.
    i32::try_from(priority >> 2).unwrap_or(i32::MAX - 1)
}

/// First bytes of a blob's stream, kind included.
///
/// # Errors
/// Refuses blobs longer than [`MAX_BLOB_BYTES`].
pub fn blob_head(id: BlobId, total: u32) -> Result<Vec<u8>, FrameError> {
    if total > MAX_BLOB_BYTES {
        return Err(FrameError::TooLong { bytes: u64::from(total), limit: MAX_BLOB_BYTES as usize });
    }
    let mut out = vec![BLOB_STREAM, 0];
    encode_message(&(id, total), &mut out).map_err(|why| FrameError::Body { what: "blob head", why })?;
    // At most 16 bytes.
    #[allow(clippy::cast_possible_truncation)]
    let length = (out.len() - 2) as u8;
    out[1] = length;
    Ok(out)
}

/// Reads a blob's stream: bytes in, pieces out. Begins after the stream's kind byte.
#[derive(Debug, Default)]
pub struct BlobStreamReader {
    head: Vec<u8>,
    blob: Option<(BlobId, u32)>,
    received: u32,
}

impl BlobStreamReader {
    /// A reader behind the stream's first byte.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The blob that the stream carries and its length, once known.
    #[must_use]
    pub const fn blob(&self) -> Option<(BlobId, u32)> {
        self.blob
    }

    /// Takes bytes of the stream and gives the pieces they make, in order, none longer than
    /// [`MAX_PIECE_BYTES`].
    ///
    /// # Errors
    /// Refuses malformed heads and bytes beyond the blob's length.
    pub fn push(&mut self, mut bytes: Bytes) -> Result<Vec<BlobPiece>, FrameError> {
        let body = |why| FrameError::Body { what: "blob head", why };
        while self.blob.is_none() && !bytes.is_empty() {
            self.head.push(bytes[0]);
            bytes = bytes.slice(1..);
            let length = usize::from(self.head[0]);
            if length > MAX_BLOB_HEAD_BYTES - 2 {
                return Err(body(CodingError::TooLong { bytes: length, limit: MAX_BLOB_HEAD_BYTES - 2 }));
            }
            if self.head.len() == 1 + length {
                let (id, total) = decode_message::<(BlobId, u32)>(&self.head[1..]).map_err(body)?;
                if total > MAX_BLOB_BYTES {
                    return Err(body(CodingError::OutOfRange("the blob is too long")));
                }
                self.blob = Some((id, total));
                if total == 0 {
                    return if bytes.is_empty() {
                        Ok(vec![BlobPiece { id, offset: 0, total, bytes }])
                    } else {
                        Err(FrameError::TrailingBytes(bytes.len()))
                    };
                }
            }
        }
        let Some((id, total)) = self.blob else { return Ok(Vec::new()) };
        let left = (total - self.received) as usize;
        if bytes.len() > left {
            return Err(FrameError::TrailingBytes(bytes.len() - left));
        }
        let mut pieces = Vec::new();
        while !bytes.is_empty() {
            let piece = bytes.split_to(bytes.len().min(MAX_PIECE_BYTES));
            let offset = self.received;
            // A piece is at most MAX_PIECE_BYTES long.
            #[allow(clippy::cast_possible_truncation)]
            {
                self.received += piece.len() as u32;
            }
            pieces.push(BlobPiece { id, offset, total, bytes: piece });
        }
        Ok(pieces)
    }

    /// Call at the stream's end.
    ///
    /// # Errors
    /// Fails where the stream ended before its blob.
    pub fn finish(&self) -> Result<(), FrameError> {
        match self.blob {
            Some((_, total)) if self.received == total => Ok(()),
            _ => Err(FrameError::Truncated),
        }
    }
}
