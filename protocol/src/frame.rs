//! Frames: the encoding of messages and blob pieces.
//!
//! A frame is `tag (1 byte) · length (QUIC variable-length integer, RFC 9000 §16) · body`. Bit 7 of the
//! tag marks messages that a peer may skip if it does not know them; other unknown tags are errors.
//! On WebSocket, one binary message carries exactly one frame; on QUIC control streams frames follow
//! each other ([`FrameReader`]).

use bytes::Bytes;

use crate::coding::{Decode, Encode, SceneValue, decode_message, encode_message};
use crate::message::{ClientMessage, MessageError, ServerMessage};
use lodestream_scene::blob::BlobId;
use lodestream_scene::encoding;
pub use lodestream_scene::encoding::CodingError;
use lodestream_scene::limits::{MAX_BLOB_BYTES, MAX_FRAME_BYTES, MAX_MESSAGE_BYTES, MAX_PIECE_BYTES};

/// Bit of a tag that lets a peer skip the message if the tag is unknown to it.
pub const OPTIONAL: u8 = 0x80;

mod tag {
    use super::OPTIONAL;
    pub(super) const HELLO: u8 = 0x01;
    pub(super) const WANT: u8 = 0x02;
    pub(super) const CANCEL: u8 = 0x03;
    pub(super) const SET_VIEW: u8 = 0x04 | OPTIONAL;
    pub(super) const WANT_SCENE_PAGES: u8 = 0x05;
    pub(super) const PING: u8 = 0x06;
    pub(super) const BYE: u8 = 0x07;
    pub(super) const TOKEN: u8 = 0x08 | OPTIONAL;
    pub(super) const WELCOME: u8 = 0x41;
    pub(super) const SCENE_PAGE: u8 = 0x42;
    pub(super) const REFUSED: u8 = 0x43;
    pub(super) const BASES_SENT: u8 = 0x44 | OPTIONAL;
    pub(super) const DONE: u8 = 0x45 | OPTIONAL;
    pub(super) const PONG: u8 = 0x46;
    pub(super) const CLOSE: u8 = 0x47;
    pub(super) const PIECE: u8 = 0x48;
    pub(super) const REFUSED_MANY: u8 = 0x49;
    pub(super) const PUNCTUAL_LIGHTS: u8 = 0x4A | OPTIONAL;
    pub(super) const PARTS: u8 = 0x4B | OPTIONAL;
    pub(super) const ANIMATIONS: u8 = 0x4C | OPTIONAL;
}

/// A frame that cannot be decoded. The session is closed with [`FrameError::close_code`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// The frame ends early.
    #[error("a frame ends early")]
    Truncated,
    /// Bytes follow the end of the frame or run.
    #[error("{0} bytes follow a frame")]
    TrailingBytes(usize),
    /// A tag that is unknown and not marked optional.
    #[error("unknown message {0:#04x}")]
    UnknownTag(u8),
    /// A QUIC stream whose first byte is unknown.
    #[error("a stream of unknown kind {0:#04x}")]
    UnknownStream(u8),
    /// Longer than allowed.
    #[error("a message of {bytes} bytes, but at most {limit} are allowed")]
    TooLong {
        /// Its length.
        bytes: u64,
        /// The greatest allowed length.
        limit: usize,
    },
    /// The body is not an encoding of the tag's message.
    #[error("malformed {what}: {why}")]
    Body {
        /// Name of the message.
        what: &'static str,
        /// What is wrong.
        why: CodingError,
    },
    /// The message has an invalid value.
    #[error("malformed message: {0}")]
    Message(#[from] MessageError),
    /// The piece has an invalid value.
    #[error("malformed piece: {0}")]
    Piece(#[from] PieceError),
}

/// An invalid piece of a blob, or head of a blob's stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PieceError {
    /// The blob is longer than [`MAX_BLOB_BYTES`].
    #[error("the blob is too long")]
    BlobTooLong,
    /// More bytes than [`MAX_PIECE_BYTES`].
    #[error("{0} bytes, but at most {MAX_PIECE_BYTES} are allowed")]
    TooLong(usize),
    /// The run ends beyond its blob.
    #[error("the run reaches beyond its blob")]
    RunBeyondBlob,
    /// The piece ends beyond its run.
    #[error("the piece reaches beyond its run")]
    BeyondRun,
    /// A piece without bytes, of a blob that is not empty.
    #[error("the piece is empty")]
    Empty,
    /// A run without bytes, of a blob that is not empty.
    #[error("the run is empty")]
    EmptyRun,
}

impl FrameError {
    /// The code to close with.
    #[must_use]
    pub fn close_code(&self) -> crate::message::CloseCode {
        match self {
            Self::TooLong { .. } => crate::message::CloseCode::Limit,
            _ => crate::message::CloseCode::Protocol,
        }
    }
}

/// A piece of a blob. A *run* is a contiguous part of a blob, whose pieces are sent in order and without gaps.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlobPiece {
    /// The blob.
    pub id: BlobId,
    /// Offset of the piece within the blob, in bytes.
    pub offset: u32,
    /// End of the run that the piece belongs to, in bytes from the start of the blob.
    pub end: u32,
    /// Length of the whole blob, in bytes.
    pub total: u32,
    /// The bytes. They may be a slice of a larger buffer and keep that alive.
    pub bytes: Bytes,
}

impl BlobPiece {
    /// Whether this piece ends its run.
    #[must_use]
    pub fn is_last(&self) -> bool {
        u64::from(self.offset) + self.bytes.len() as u64 >= u64::from(self.end)
    }

    fn check(&self) -> Result<(), PieceError> {
        if self.total > MAX_BLOB_BYTES {
            return Err(PieceError::BlobTooLong);
        }
        if self.bytes.len() > MAX_PIECE_BYTES {
            return Err(PieceError::TooLong(self.bytes.len()));
        }
        if self.end > self.total {
            return Err(PieceError::RunBeyondBlob);
        }
        if u64::from(self.offset) + self.bytes.len() as u64 > u64::from(self.end) {
            return Err(PieceError::BeyondRun);
        }
        if self.bytes.is_empty() && self.total > 0 {
            return Err(PieceError::Empty);
        }
        Ok(())
    }
}

/// The content of a frame from the server.
#[derive(Clone, Debug, PartialEq)]
pub enum ServerFrame {
    /// A control message.
    Message(ServerMessage),
    /// A piece of a blob (WebSocket only; on QUIC blobs have their own streams).
    Piece(BlobPiece),
}

/// A frame with an undecoded body.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    tag: u8,
    body: Bytes,
}

/// Appends a length of up to 2^30 − 1 in 1, 2 or 4 bytes (RFC 9000 §16).
pub(crate) fn put_length(length: usize, out: &mut Vec<u8>) {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the bounds make the casts exact; every caller refuses longer bodies beforehand"
    )]
    match length {
        0..0x40 => out.push(length as u8),
        0x40..0x4000 => out.extend_from_slice(&(length as u16 | 0x4000).to_be_bytes()),
        _ => out.extend_from_slice(&((length as u32 & 0x3FFF_FFFF) | 0x8000_0000).to_be_bytes()),
    }
}

/// Reads a length; returns it and its size in bytes, or `None` if more bytes are needed. Reads the 8-byte form too,
/// which is always too long, so that the error can state the length.
pub(crate) fn get_length(bytes: &[u8]) -> Option<(u64, usize)> {
    let first = *bytes.first()?;
    let size = 1_usize << (first >> 6);
    let mut value = u64::from(first & 0x3F);
    for &byte in bytes.get(1..size)? {
        value = value << 8 | u64::from(byte);
    }
    Some((value, size))
}

impl Frame {
    /// Finds the first frame of `bytes`; returns its tag and the range of its body, or `None` if more bytes are needed.
    fn split(bytes: &[u8]) -> Result<Option<(u8, std::ops::Range<usize>)>, FrameError> {
        let Some(&tag) = bytes.first() else { return Ok(None) };
        let Some((length, size)) = get_length(&bytes[1..]) else { return Ok(None) };
        let limit = MAX_MESSAGE_BYTES;
        let length = usize::try_from(length)
            .ok()
            .filter(|&n| n <= limit)
            .ok_or(FrameError::TooLong { bytes: length, limit })?;
        let start = 1 + size;
        Ok((bytes.len() - start >= length).then_some((tag, start..start + length)))
    }

    /// Reads a frame that fills `bytes` exactly (one WebSocket message).
    ///
    /// # Errors
    /// Refuses frames that are truncated, too long or followed by more bytes.
    pub fn parse(bytes: Bytes) -> Result<Self, FrameError> {
        let (tag, body) = Self::split(&bytes)?.ok_or(FrameError::Truncated)?;
        if body.end < bytes.len() {
            return Err(FrameError::TrailingBytes(bytes.len() - body.end));
        }
        Ok(Self { tag, body: bytes.slice(body) })
    }

    /// Decodes a frame from a client. Returns `None` for an unknown message that may be skipped.
    ///
    /// # Errors
    /// Refuses unknown messages that are not optional, and malformed bodies.
    pub fn into_client_message(self) -> Result<Option<ClientMessage>, FrameError> {
        let body = &self.body;
        let message = match self.tag {
            tag::HELLO => ClientMessage::Hello(decode("Hello", body)?),
            tag::WANT => ClientMessage::Want(decode("Want", body)?),
            tag::CANCEL => ClientMessage::Cancel(decode_scene_value("Cancel", body)?),
            tag::SET_VIEW => ClientMessage::SetView(decode_scene_value("SetView", body)?),
            tag::WANT_SCENE_PAGES => ClientMessage::WantScenePages(decode("WantScenePages", body)?),
            tag::PING => ClientMessage::Ping(decode("Ping", body)?),
            tag::BYE => decode::<()>("Bye", body).map(|()| ClientMessage::Bye)?,
            tag::TOKEN => ClientMessage::Token(decode("Token", body)?),
            unknown if unknown & OPTIONAL != 0 => return Ok(None),
            unknown => return Err(FrameError::UnknownTag(unknown)),
        };
        message.check()?;
        Ok(Some(message))
    }

    /// Decodes a frame from a server. Returns `None` for an unknown message that may be skipped.
    ///
    /// # Errors
    /// Refuses unknown messages that are not optional, and malformed bodies.
    pub fn into_server_frame(self) -> Result<Option<ServerFrame>, FrameError> {
        let body = &self.body;
        let message = match self.tag {
            tag::WELCOME => ServerMessage::Welcome(decode("Welcome", body)?),
            tag::SCENE_PAGE => ServerMessage::ScenePage(decode_scene_value("ScenePage", body)?),
            tag::PUNCTUAL_LIGHTS => {
                ServerMessage::PunctualLights(decode_scene_value("PunctualLights", body)?)
            }
            tag::PARTS => ServerMessage::Parts(decode_scene_value("Parts", body)?),
            tag::ANIMATIONS => ServerMessage::Animations(decode_scene_value("Animations", body)?),
            tag::REFUSED => ServerMessage::Refused(decode("Refused", body)?),
            tag::REFUSED_MANY => ServerMessage::RefusedMany(decode("RefusedMany", body)?),
            tag::BASES_SENT => decode::<()>("BasesSent", body).map(|()| ServerMessage::BasesSent)?,
            tag::DONE => decode::<()>("Done", body).map(|()| ServerMessage::Done)?,
            tag::PONG => ServerMessage::Pong(decode("Pong", body)?),
            tag::CLOSE => ServerMessage::Close(decode("Close", body)?),
            tag::PIECE => return Self::piece(&self.body).map(|piece| Some(ServerFrame::Piece(piece))),
            unknown if unknown & OPTIONAL != 0 => return Ok(None),
            unknown => return Err(FrameError::UnknownTag(unknown)),
        };
        message.check()?;
        Ok(Some(ServerFrame::Message(message)))
    }

    /// A piece: length of the head, head, bytes. The bytes are not copied.
    fn piece(body: &Bytes) -> Result<BlobPiece, FrameError> {
        let head = usize::from(*body.first().ok_or(FrameError::Truncated)?);
        let end = 1 + head;
        let head = body.get(1..end).ok_or(FrameError::Truncated)?;
        // The bytes after the run are nearly always 0, which takes one byte.
        let (SceneValue(id), offset, total, behind): (_, _, u32, u32) = decode("piece", head)?;
        let run_end = total.checked_sub(behind).ok_or(PieceError::RunBeyondBlob)?;
        let piece = BlobPiece { id, offset, end: run_end, total, bytes: body.slice(end..) };
        piece.check()?;
        Ok(piece)
    }
}

fn decode<T: Decode<()>>(what: &'static str, body: &[u8]) -> Result<T, FrameError> {
    decode_message(body).map_err(|why| FrameError::Body { what, why })
}

fn decode_scene_value<T: encoding::Decode>(what: &'static str, body: &[u8]) -> Result<T, FrameError> {
    decode(what, body).map(|SceneValue(value)| value)
}

fn frame<T: Encode>(what: &'static str, tag: u8, body: &T) -> Result<Vec<u8>, FrameError> {
    let mut bytes = Vec::new();
    encode_message(body, &mut bytes).map_err(|why| FrameError::Body { what, why })?;
    wrap(tag, &bytes)
}

fn wrap(tag: u8, body: &[u8]) -> Result<Vec<u8>, FrameError> {
    if body.len() > MAX_MESSAGE_BYTES {
        return Err(FrameError::TooLong { bytes: body.len() as u64, limit: MAX_MESSAGE_BYTES });
    }
    let mut out = Vec::with_capacity(body.len() + 5);
    out.push(tag);
    put_length(body.len(), &mut out);
    out.extend_from_slice(body);
    Ok(out)
}

/// The frame of a client's message.
///
/// # Errors
/// Refuses messages that [`Frame::into_client_message`] would refuse.
pub fn encode_client(message: &ClientMessage) -> Result<Vec<u8>, FrameError> {
    message.check()?;
    match message {
        ClientMessage::Hello(hello) => frame("Hello", tag::HELLO, hello),
        ClientMessage::Want(wants) => frame("Want", tag::WANT, wants),
        ClientMessage::Cancel(ids) => frame("Cancel", tag::CANCEL, &SceneValue(ids)),
        ClientMessage::SetView(view) => frame("SetView", tag::SET_VIEW, &SceneValue(view)),
        ClientMessage::WantScenePages(pages) => frame("WantScenePages", tag::WANT_SCENE_PAGES, pages),
        ClientMessage::Ping(nonce) => frame("Ping", tag::PING, nonce),
        ClientMessage::Bye => frame("Bye", tag::BYE, &()),
        ClientMessage::Token(token) => frame("Token", tag::TOKEN, token),
    }
}

/// The frame of a server's message.
///
/// # Errors
/// Refuses messages that [`Frame::into_server_frame`] would refuse.
pub fn encode_server(message: &ServerMessage) -> Result<Vec<u8>, FrameError> {
    message.check()?;
    match message {
        ServerMessage::Welcome(welcome) => frame("Welcome", tag::WELCOME, welcome),
        ServerMessage::ScenePage(page) => frame("ScenePage", tag::SCENE_PAGE, &SceneValue(page)),
        ServerMessage::PunctualLights(punctual_lights) => {
            frame("PunctualLights", tag::PUNCTUAL_LIGHTS, &SceneValue(punctual_lights))
        }
        ServerMessage::Parts(table) => frame("Parts", tag::PARTS, &SceneValue(table)),
        ServerMessage::Animations(table) => frame("Animations", tag::ANIMATIONS, &SceneValue(table)),
        ServerMessage::Refused(refused) => frame("Refused", tag::REFUSED, refused),
        ServerMessage::RefusedMany(many) => frame("RefusedMany", tag::REFUSED_MANY, many),
        ServerMessage::BasesSent => frame("BasesSent", tag::BASES_SENT, &()),
        ServerMessage::Done => frame("Done", tag::DONE, &()),
        ServerMessage::Pong(nonce) => frame("Pong", tag::PONG, nonce),
        ServerMessage::Close(close) => frame("Close", tag::CLOSE, close),
    }
}

/// The frame of a blob piece (WebSocket only).
///
/// # Errors
/// Refuses pieces longer than [`MAX_PIECE_BYTES`] or beyond their blob.
pub fn encode_piece(piece: &BlobPiece) -> Result<Vec<u8>, FrameError> {
    piece.check()?;
    let mut body = vec![0];
    encode_message(&(SceneValue(piece.id), piece.offset, piece.total, piece.total - piece.end), &mut body)
        .map_err(|why| FrameError::Body { what: "piece", why })?;
    #[expect(clippy::cast_possible_truncation, reason = "an id takes at most 11 bytes, the numbers 5 each")]
    let head = (body.len() - 1) as u8;
    body[0] = head;
    body.extend_from_slice(&piece.bytes);
    wrap(tag::PIECE, &body)
}

/// Cuts a byte stream (a QUIC control stream) into frames.
///
/// Holds at most one frame that is not complete yet, [`MAX_FRAME_BYTES`], beside what was last pushed.
#[derive(Debug, Default)]
pub struct FrameReader {
    buffer: Vec<u8>,
    /// Bytes at the front of the buffer that are done with.
    used: usize,
}

impl FrameReader {
    /// A reader at the start of a stream.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes bytes of the stream. Call [`FrameReader::next_frame`] until it gives `None` before pushing more.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.drain(..self.used);
        self.used = 0;
        self.buffer.extend_from_slice(bytes);
    }

    /// The next complete frame, if there is one.
    ///
    /// # Errors
    /// Refuses frames that are too long; the stream cannot be read on after that.
    pub fn next_frame(&mut self) -> Result<Option<Frame>, FrameError> {
        let rest = &self.buffer[self.used..];
        let Some((tag, body)) = Frame::split(rest)? else { return Ok(None) };
        let end = body.end;
        let frame = Frame { tag, body: Bytes::copy_from_slice(&rest[body]) };
        self.used += end;
        Ok(Some(frame))
    }

    /// Bytes that are held and belong to no complete frame. Not zero at a stream's end: it was cut.
    #[must_use]
    pub fn pending(&self) -> usize {
        debug_assert!(self.buffer.len() - self.used <= MAX_FRAME_BYTES || self.used == 0);
        self.buffer.len() - self.used
    }
}

#[cfg(test)]
mod tests;
