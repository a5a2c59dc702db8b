//! Mapping of messages and blobs onto the two transports.
//!
//! **QUIC** (ALPN [`ALPN`]). The client opens one unidirectional stream for its frames. The server opens
//! one unidirectional stream for its control frames and one for each run of a blob, so that a lost packet delays
//! one blob only and a cancelled blob's stream can be reset. A stream's first byte says which kind it is
//! ([`CONTROL_STREAM`], [`BLOB_STREAM`], [`PAGE_STREAM`]); a blob's stream goes on with [`blob_head`] and the blob's bytes,
//! and ends. A scene page that no first frame waits for has a stream of its own, too. Stream priorities follow [`quic_priority`].
//!
//! **WebSocket** (subprotocol [`ALPN`]). Each binary message is one [`crate::frame::Frame`]; blobs travel
//! as pieces of a few KiB so that an urgent one does not wait behind a large one. Text messages are
//! refused.

use bytes::Bytes;
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, percent_decode_str, utf8_percent_encode};

use crate::coding::{SceneValue, decode_message, encode_message};
use crate::frame::{BlobPiece, FrameError, PieceError};
use lodestream_scene::blob::BlobId;
use lodestream_scene::encoding::CodingError;
use lodestream_scene::limits::{MAX_BLOB_BYTES, MAX_NAME_BYTES, MAX_PIECE_BYTES};

/// Name of the protocol in TLS ALPN and as WebSocket subprotocol. A subprotocol is a token (RFC 6455, 11.3.4), which
/// contains no slash: browsers refuse to ask for others.
pub const ALPN: &str = "lodestream.2";

/// ALPN name of a session with the scene `name`: [`ALPN`], a slash, and the first 32 hexadecimal digits of the name's
/// BLAKE3 hash. A client offers it before [`ALPN`], so that a server with several scenes can choose the scene before
/// `Hello`.
#[must_use]
pub fn alpn_of_scene(name: &str) -> String {
    format!("{ALPN}/{}", &blake3::hash(name.as_bytes()).to_hex()[..32])
}

/// Characters that are not percent-encoded in a path (RFC 3986, section 2.3).
const UNRESERVED: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~');

/// The path of a scene in addresses and in WebSocket's request: `/NAME`, percent-encoded (RFC 3986); `/` without a
/// name.
#[must_use]
pub fn path_of_scene(name: &str) -> String {
    format!("/{}", utf8_percent_encode(name, UNRESERVED))
}

/// Inverse of [`path_of_scene`]: the scene's name, empty for `/`. `None` if the path has a second slash, a query,
/// invalid encoding or too long a name.
#[must_use]
pub fn scene_of_path(path: &str) -> Option<String> {
    let name = path.strip_prefix('/')?;
    let decoded = percent_decode_str(name).decode_utf8().ok()?;
    (decoded.len() <= MAX_NAME_BYTES && !name.contains(['/', '?'])).then(|| decoded.into_owned())
}

/// Query of the request for a session of a client that has something of the scene already: the server pushes nothing
/// before `Hello` says what.
pub const RESUME_QUERY: &str = "resume";

/// First byte of a stream of control frames, in both directions.
pub const CONTROL_STREAM: u8 = 0;
/// First byte of a stream that carries a run of one blob.
pub const BLOB_STREAM: u8 = 1;
/// First byte of a stream that carries the frame of one scene page.
pub const PAGE_STREAM: u8 = 2;
/// Longest head of a blob's stream: kind, length of the head, id, total length, offset of the run, and bytes after it.
pub const MAX_BLOB_HEAD_BYTES: usize = 1 + 1 + 11 + 5 + 5 + 5;

/// Stream priority for quinn (higher first) of a blob with `priority`. Below `i32::MAX`, which is for control streams.
#[must_use]
pub fn quic_priority(priority: u32) -> i32 {
    // Half the range, so that the order is kept and i32::MAX stays free.
    i32::try_from(priority >> 2).unwrap_or(i32::MAX - 1)
}

/// The first bytes of a blob's stream, with the kind, for a run that begins with `first`.
///
/// # Errors
/// If the blob is longer than [`MAX_BLOB_BYTES`] or the run ends beyond it.
pub fn blob_head(first: &BlobPiece) -> Result<Vec<u8>, FrameError> {
    let BlobPiece { id, offset, end, total, .. } = *first;
    if total > MAX_BLOB_BYTES {
        return Err(FrameError::TooLong { bytes: u64::from(total), limit: MAX_BLOB_BYTES as usize });
    }
    let mut out = vec![BLOB_STREAM, 0];
    let body = |why| FrameError::Body { what: "blob head", why };
    let behind = total.checked_sub(end).ok_or(PieceError::RunBeyondBlob)?;
    encode_message(&(SceneValue(id), total, offset, behind), &mut out).map_err(body)?;
    #[expect(clippy::cast_possible_truncation, reason = "at most 26 bytes")]
    let length = (out.len() - 2) as u8;
    out[1] = length;
    Ok(out)
}

/// Incremental parser of a blob's stream, after the stream's kind byte.
#[derive(Debug, Default)]
pub struct BlobStreamReader {
    head: Vec<u8>,
    blob: Option<(BlobId, u32)>,
    /// Start of the next piece, and end of the run.
    next: u32,
    end: u32,
}

impl BlobStreamReader {
    /// A reader at the second byte of the stream.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The blob and its total length, once the head is complete.
    #[must_use]
    pub const fn blob(&self) -> Option<(BlobId, u32)> {
        self.blob
    }

    /// Takes bytes of the stream; returns the pieces in them, in order, none longer than [`MAX_PIECE_BYTES`].
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
                let (SceneValue(id), total, offset, behind) =
                    decode_message::<(SceneValue<BlobId>, u32, u32, u32)>(&self.head[1..]).map_err(body)?;
                if total > MAX_BLOB_BYTES {
                    return Err(PieceError::BlobTooLong.into());
                }
                let end = total.checked_sub(behind).filter(|&end| offset < end || total == 0);
                self.end = end.ok_or(PieceError::EmptyRun)?;
                self.next = offset;
                self.blob = Some((id, total));
                if total == 0 {
                    return if bytes.is_empty() && offset == 0 {
                        Ok(vec![BlobPiece { id, offset: 0, end: 0, total, bytes }])
                    } else {
                        Err(FrameError::TrailingBytes(bytes.len()))
                    };
                }
            }
        }
        let Some((id, total)) = self.blob else { return Ok(Vec::new()) };
        let left = self.end.saturating_sub(self.next) as usize;
        if bytes.len() > left {
            return Err(FrameError::TrailingBytes(bytes.len() - left));
        }
        let mut pieces = Vec::new();
        while !bytes.is_empty() {
            let piece = bytes.split_to(bytes.len().min(MAX_PIECE_BYTES));
            let offset = self.next;
            #[expect(clippy::cast_possible_truncation, reason = "a piece is at most MAX_PIECE_BYTES long")]
            {
                self.next += piece.len() as u32;
            }
            pieces.push(BlobPiece { id, offset, end: self.end, total, bytes: piece });
        }
        Ok(pieces)
    }

    /// Checks the end of the stream.
    ///
    /// # Errors
    /// If the stream ended before its run.
    pub fn finish(&self) -> Result<(), FrameError> {
        match self.blob {
            Some(_) if self.next == self.end => Ok(()),
            _ => Err(FrameError::Truncated),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// RFC 9110, 5.6.2.
    #[test]
    fn the_subprotocol_is_a_token() {
        let is_token = |c: char| c.is_ascii_alphanumeric() || "!#$%&'*+-.^_`|~".contains(c);
        assert!(!ALPN.is_empty() && ALPN.chars().all(is_token), "{ALPN}");
    }

    fn stream(id: BlobId, bytes: &[u8]) -> Vec<u8> {
        let total = u32::try_from(bytes.len()).unwrap();
        let first = BlobPiece { id, offset: 0, end: total, total, bytes: Bytes::new() };
        let mut stream = blob_head(&first).unwrap();
        assert!(stream.len() <= MAX_BLOB_HEAD_BYTES && stream[0] == BLOB_STREAM);
        stream.extend_from_slice(bytes);
        stream.split_off(1)
    }

    fn read(stream: &[u8], step: usize) -> Result<Vec<u8>, FrameError> {
        let mut reader = BlobStreamReader::new();
        let mut blob = Vec::new();
        for part in stream.chunks(step) {
            for piece in reader.push(Bytes::copy_from_slice(part))? {
                assert_eq!(piece.offset as usize, blob.len());
                blob.extend_from_slice(&piece.bytes);
            }
        }
        reader.finish().map(|()| blob)
    }

    #[test]
    fn blobs_are_the_same_however_the_stream_is_cut() {
        for id in
            [BlobId::base(0), BlobId::texture(u32::MAX, u16::MAX, 255), BlobId::height_overrides(u32::MAX)]
        {
            for length in [0, 1, 700, 40_000] {
                let blob: Vec<u8> = (0..length).map(|i| (i % 251) as u8).collect();
                let stream = stream(id, &blob);
                for step in [1, 3, 1200, 100_000] {
                    assert_eq!(read(&stream, step).unwrap(), blob);
                }
            }
        }
    }

    #[test]
    fn cut_and_overlong_streams_are_refused() {
        let whole = stream(BlobId::chunk(1, 2), &[5; 300]);
        for length in 0..whole.len() {
            assert_eq!(read(&whole[..length], 64), Err(FrameError::Truncated), "length {length}");
        }
        let longer: Vec<u8> = whole.iter().copied().chain([0]).collect();
        assert_eq!(read(&longer, 1000), Err(FrameError::TrailingBytes(1)));
        let (id, total) = (BlobId::base(0), MAX_BLOB_BYTES + 1);
        assert!(blob_head(&BlobPiece { id, offset: 0, end: total, total, bytes: Bytes::new() }).is_err());
        assert!(read(&[255, 0, 0], 9).is_err());
    }

    #[test]
    fn parts_of_blobs_round_trip_with_their_offsets() {
        let id = BlobId::chunk(1, 2);
        for (offset, end) in [(0, 300), (300, 1000), (299, 301), (0, 1)] {
            let first = BlobPiece { id, offset, end, total: 1000, bytes: Bytes::new() };
            let mut bytes = blob_head(&first).unwrap().split_off(1);
            bytes.extend(vec![7; (end - offset) as usize]);
            let mut reader = BlobStreamReader::new();
            let mut next = offset;
            for part in bytes.chunks(100) {
                for piece in reader.push(Bytes::copy_from_slice(part)).unwrap() {
                    assert_eq!((piece.offset, piece.end, piece.total), (next, end, 1000));
                    next += u32::try_from(piece.bytes.len()).unwrap();
                }
            }
            assert_eq!((reader.finish(), next), (Ok(()), end));
            assert!(reader.push(Bytes::from_static(b"x")).is_err(), "bytes behind the run");
        }
        let beyond = BlobPiece { id, offset: 0, end: 11, total: 10, bytes: Bytes::new() };
        assert!(blob_head(&beyond).is_err());
        for (offset, behind) in [(0, 11_u32), (10, 0), (5, 5), (6, 5)] {
            let mut head = vec![0];
            encode_message(&(SceneValue(id), 10_u32, offset, behind), &mut head).unwrap();
            head[0] = u8::try_from(head.len() - 1).unwrap();
            assert!(BlobStreamReader::new().push(head.into()).is_err(), "from {offset}, {behind} left out");
        }
    }

    #[test]
    fn priorities_keep_their_order() {
        let order = [0, 4, 1 << 23, 1 << 30, u32::MAX].map(quic_priority);
        assert!(order.is_sorted() && order[0] >= 0 && order[4] < i32::MAX);
    }

    proptest::proptest! {
        #[test]
        fn random_streams_never_panic(bytes in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..100)) {
            let _ = read(&bytes, 7);
        }
    }
}
