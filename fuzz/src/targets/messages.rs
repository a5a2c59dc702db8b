//! Wire formats: frames of both peers, streams of frames and of blobs, asset descriptions.

use bytes::Bytes;
use lodestream_protocol::frame::{
    Frame, FrameReader, ServerFrame, encode_client, encode_piece, encode_server,
};
use lodestream_protocol::stream::BlobStreamReader;
use lodestream_scene::asset::AssetDescription;

use crate::meter::{Ceiling, within};

/// The first byte selects the format of the others: a frame of a client or of a server, a control stream in pieces, a
/// blob's stream in pieces, or an asset description. Accepted values are equal after encoding and decoding.
pub fn messages(data: &[u8]) -> bool {
    let Some((&kind, body)) = data.split_first() else { return false };
    let bytes = Bytes::copy_from_slice(body);
    within(WIRE, body.len(), || match kind % 5 {
        0 => client_frame(bytes),
        1 => server_frame(bytes),
        2 => control_stream(body),
        3 => blob_stream(&bytes),
        _ => description(body),
    })
}

/// Decoding reserves at most 256 KiB for a message and 2 MiB for an asset description, whatever they claim; the value
/// is encoded and decoded again.
const WIRE: Ceiling = Ceiling { base_bytes: 8 << 20, bytes_per_byte: 64, base_steps: 0, steps_per_byte: 0 };

fn client_frame(bytes: Bytes) -> bool {
    let Ok(Some(message)) = Frame::parse(bytes).and_then(Frame::into_client_message) else { return false };
    let again = encode_client(&message).expect("an accepted message is encoded");
    let again = Frame::parse(again.into()).and_then(Frame::into_client_message);
    assert_eq!(again, Ok(Some(message)));
    true
}

fn server_frame(bytes: Bytes) -> bool {
    let Ok(Some(frame)) = Frame::parse(bytes).and_then(Frame::into_server_frame) else { return false };
    let again = match &frame {
        ServerFrame::Message(message) => encode_server(message),
        ServerFrame::Piece(piece) => encode_piece(piece),
    };
    let again = Frame::parse(again.expect("an accepted frame is encoded").into());
    assert_eq!(again.and_then(Frame::into_server_frame), Ok(Some(frame)));
    true
}

/// A stream has the same frames however it is cut.
fn control_stream(body: &[u8]) -> bool {
    let read = |step: usize| {
        let mut reader = FrameReader::new();
        let mut frames = Vec::new();
        for part in body.chunks(step) {
            reader.push(part);
            loop {
                match reader.next_frame() {
                    Ok(Some(frame)) => frames.push(frame),
                    Ok(None) => break,
                    Err(error) => return (frames, Some(error)),
                }
            }
        }
        (frames, None)
    };
    let whole = read(body.len().max(1));
    assert_eq!(whole, read(3));
    whole.0.into_iter().any(|frame| matches!(frame.into_client_message(), Ok(Some(_))))
}

fn blob_stream(bytes: &Bytes) -> bool {
    let read = |step: usize| {
        let mut reader = BlobStreamReader::new();
        let (mut first, mut blob) = (None, Vec::new());
        for at in (0..bytes.len()).step_by(step) {
            for piece in reader.push(bytes.slice(at..bytes.len().min(at + step)))? {
                let begin = *first.get_or_insert(piece.offset);
                assert_eq!((piece.offset - begin) as usize, blob.len());
                assert!(piece.offset as usize + piece.bytes.len() <= piece.end as usize);
                assert!(piece.end <= piece.total);
                blob.extend_from_slice(&piece.bytes);
            }
        }
        reader.finish().map(|()| (first, blob))
    };
    let whole = read(bytes.len().max(1));
    assert_eq!(whole.clone().ok(), read(7).ok());
    whole.is_ok()
}

fn description(body: &[u8]) -> bool {
    let Ok(description) = AssetDescription::decode(body) else { return false };
    let again = description.encode().expect("an accepted description is encoded");
    let again = AssetDescription::decode(&again).expect("an encoded description is accepted");
    assert_eq!(format!("{again:?}"), format!("{description:?}"));
    true
}
