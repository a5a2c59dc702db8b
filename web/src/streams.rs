//! The server's streams of a WebTransport session: one of frames, one for each run of a blob, and one for each page for
//! which no first frame waits.

use std::collections::BTreeMap;

use bytes::{Buf as _, Bytes};
use lodestream_protocol::frame::{BlobPiece, Frame, FrameError, FrameReader, ServerFrame};
use lodestream_protocol::stream::{BLOB_STREAM, BlobStreamReader, CONTROL_STREAM, PAGE_STREAM};
use lodestream_scene::BlobId;

/// What arrived on a stream.
pub(crate) enum Arrival {
    /// A frame of the control stream or of a page.
    Frame(ServerFrame),
    /// A piece of a blob.
    Piece(BlobPiece),
}

enum Kind {
    /// Its type byte has not arrived.
    Unknown,
    Control(FrameReader),
    Page(FrameReader),
    Blob(BlobStreamReader),
}

/// Parsers of the streams that are open, by the numbers that the script gives them.
#[derive(Default)]
pub(crate) struct Streams {
    open: BTreeMap<u32, Kind>,
    has_control: bool,
}

impl Streams {
    /// Takes bytes of a stream.
    pub(crate) fn push(&mut self, stream: u32, mut bytes: Bytes) -> Result<Vec<Arrival>, FrameError> {
        let kind = self.open.entry(stream).or_insert(Kind::Unknown);
        if matches!(kind, Kind::Unknown) && !bytes.is_empty() {
            *kind = match bytes.get_u8() {
                CONTROL_STREAM if !self.has_control => Kind::Control(FrameReader::new()),
                BLOB_STREAM => Kind::Blob(BlobStreamReader::new()),
                PAGE_STREAM => Kind::Page(FrameReader::new()),
                unknown => return Err(FrameError::UnknownStream(unknown)),
            };
            self.has_control |= matches!(kind, Kind::Control(_));
        }
        match kind {
            Kind::Unknown => Ok(Vec::new()),
            Kind::Control(frames) | Kind::Page(frames) => {
                frames.push(&bytes);
                let mut arrivals = Vec::new();
                while let Some(frame) = frames.next_frame()? {
                    // Frames of a later version are skipped.
                    arrivals.extend(frame.into_server_frame()?.map(Arrival::Frame));
                }
                Ok(arrivals)
            }
            Kind::Blob(blob) => Ok(blob.push(bytes)?.into_iter().map(Arrival::Piece).collect()),
        }
    }

    /// Takes the end of a stream.
    pub(crate) fn end(&mut self, stream: u32) -> Result<(), FrameError> {
        match self.open.remove(&stream) {
            Some(Kind::Control(frames) | Kind::Page(frames)) if frames.pending() > 0 => {
                Err(FrameError::Truncated)
            }
            Some(Kind::Blob(blob)) => blob.finish(),
            _ => Ok(()),
        }
    }

    /// Takes the reset of a stream; gives the blob that it carried.
    pub(crate) fn reset(&mut self, stream: u32) -> Option<BlobId> {
        match self.open.remove(&stream)? {
            Kind::Blob(blob) => blob.blob().map(|(id, _)| id),
            Kind::Control(_) | Kind::Page(_) | Kind::Unknown => None,
        }
    }
}

impl std::fmt::Debug for Streams {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Streams({} open)", self.open.len())
    }
}

/// A frame as one message of a WebSocket carries it; none if it is of a later version.
pub(crate) fn message(bytes: Vec<u8>) -> Result<Option<ServerFrame>, FrameError> {
    Frame::parse(bytes.into()).and_then(Frame::into_server_frame)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_protocol::frame::encode_server;
    use lodestream_protocol::message::ServerMessage;
    use lodestream_protocol::stream::blob_head;

    fn of_blob(bytes: &[u8]) -> Vec<u8> {
        let total = u32::try_from(bytes.len()).unwrap();
        let head = BlobPiece { id: BlobId::chunk(1, 2), offset: 0, end: total, total, bytes: Bytes::new() };
        [&blob_head(&head).unwrap(), bytes].concat()
    }

    #[test]
    fn frames_and_blobs_arrive_however_their_streams_are_cut() {
        let frames = [ServerMessage::BasesSent, ServerMessage::Done].map(|m| encode_server(&m).unwrap());
        let control = [&[CONTROL_STREAM][..], &frames.concat()].concat();
        let page = [&[PAGE_STREAM][..], &encode_server(&ServerMessage::Done).unwrap()].concat();
        let blob = of_blob(&[7; 300]);
        for step in [1, 5, 1000] {
            let mut streams = Streams::default();
            let (mut messages, mut bytes) = (0, Vec::new());
            let streams_of_server = [(0, &control), (1, &blob), (2, &page)];
            let parts = streams_of_server
                .iter()
                .flat_map(|(stream, bytes)| bytes.chunks(step).map(move |part| (*stream, part)));
            for (stream, part) in parts {
                for arrival in streams.push(stream, Bytes::copy_from_slice(part)).unwrap() {
                    match arrival {
                        Arrival::Frame(_) => messages += 1,
                        Arrival::Piece(piece) => bytes.extend_from_slice(&piece.bytes),
                    }
                }
            }
            assert_eq!([0, 1, 2].map(|stream| streams.end(stream)), [Ok(()), Ok(()), Ok(())]);
            assert_eq!((messages, bytes), (3, vec![7; 300]));
        }
    }

    #[test]
    fn cut_unknown_and_second_control_streams_are_errors() {
        let mut streams = Streams::default();
        let blob = of_blob(&[7; 300]);
        assert!(streams.push(0, Bytes::copy_from_slice(&blob[..100])).is_ok());
        assert_eq!(streams.end(0), Err(FrameError::Truncated));
        assert!(streams.push(1, Bytes::from_static(&[9])).is_err());
        assert!(streams.push(2, Bytes::from_static(&[CONTROL_STREAM])).is_ok());
        assert!(streams.push(3, Bytes::from_static(&[CONTROL_STREAM])).is_err());
    }

    #[test]
    fn a_reset_names_its_blob() {
        let mut streams = Streams::default();
        streams.push(4, Bytes::copy_from_slice(&of_blob(&[7; 300])[..50])).unwrap();
        assert_eq!(streams.reset(4), Some(BlobId::chunk(1, 2)));
        assert_eq!(streams.reset(4), None);
    }
}
