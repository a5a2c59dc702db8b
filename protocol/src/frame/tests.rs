//! Every message at every length, and random bytes.

use proptest::prelude::*;

use super::*;
use crate::message::*;
use crate::source::SceneSource;
use crate::testing::MemoryScene;
use lodestream_scene::description::{Instance, ScenePage};
use lodestream_scene::limits::{MAX_HAVE, MAX_IDS_PER_MESSAGE};
use lodestream_scene::parts::PartTable;
use lodestream_scene::placement::Placement;
use lodestream_scene::punctual_lights::PunctualLights;
use lodestream_scene::view::View;

fn view() -> View {
    View::look_at([1.0, 2.0, 3.0], [0.0; 3], [0.0, 1.0, 0.0], 0.9, [1280, 720])
}

fn client_messages() -> Vec<ClientMessage> {
    let ids =
        vec![BlobId::base(0), BlobId::index_page(3, 4), BlobId::chunk(70_000, 300), BlobId::texture(1, 2, 3)];
    let wants = ids.iter().map(|&id| Want::whole(id, 1 << 30)).collect();
    vec![
        ClientMessage::Hello(Hello {
            view: Some(view()),
            max_blob_bytes: 1 << 20,
            budget_bytes: 1 << 29,
            fingerprint: [9; 16],
            have: ids.clone(),
            ..Hello::new("temple")
        }),
        ClientMessage::Want(wants),
        ClientMessage::Cancel(ids),
        ClientMessage::SetView(view()),
        ClientMessage::WantScenePages(vec![0, 1, 1000]),
        ClientMessage::Ping(77),
        ClientMessage::Bye,
        ClientMessage::Token(Token("head.claims.signature".into())),
    ]
}

fn server_messages() -> Vec<ServerMessage> {
    let scene = MemoryScene::new(2, 9, 2);
    let mut messages = vec![
        ServerMessage::Welcome(Welcome {
            version: 1,
            session: 12,
            rate_bits_per_s: 2_000_000,
            idle_timeout_ms: 30_000,
            scene: scene.header.clone(),
        }),
        ServerMessage::PunctualLights(PunctualLights { count: 2000, first: Vec::new() }),
        ServerMessage::Parts(PartTable { records: 5000 }),
        ServerMessage::Refused(Refused { id: BlobId::chunk(3, 4), reason: RefusedReason::NotFound }),
        ServerMessage::BasesSent,
        ServerMessage::Done,
        ServerMessage::Pong(8),
        ServerMessage::Close(Close::new(CloseCode::ShuttingDown, "the server shuts down")),
    ];
    messages.extend(scene.pages.iter().map(|page| ServerMessage::ScenePage((**page).clone())));
    let odd = Instance {
        asset: 0,
        placement: Placement {
            translation: [0.1, 1e7 + 0.001, -3.0],
            rotation: [0.5, 0.5, 0.5, 0.5],
            scale: 0.25,
        },
    };
    let about_y = Instance {
        asset: 0,
        placement: Placement { rotation: [0.0, 0.6, 0.0, 0.8], scale: 3.0, ..Placement::at([1.0; 3]) },
    };
    // A negative zero in a rotation is not written; what comes back is as good.
    let unturned = Instance {
        asset: 0,
        placement: Placement { rotation: [0.0, -0.0, 0.0, 1.0], ..Placement::at([2.0; 3]) },
    };
    messages.push(ServerMessage::ScenePage(ScenePage {
        page: 5,
        first_asset: 9,
        first_instance: 70,
        assets: Vec::new(),
        instances: vec![odd, about_y, unturned],
        ..ScenePage::default()
    }));
    messages
}

fn piece() -> BlobPiece {
    BlobPiece {
        id: BlobId::chunk(3, 400),
        offset: 8,
        end: 40,
        total: 40,
        bytes: Bytes::from_static(b"0123456789"),
    }
}

/// All kinds of frames that the crate can make.
fn frames() -> Vec<Vec<u8>> {
    let client = client_messages().into_iter().map(|m| encode_client(&m).unwrap());
    let server = server_messages().into_iter().map(|m| encode_server(&m).unwrap());
    client.chain(server).chain([encode_piece(&piece()).unwrap()]).collect()
}

#[test]
fn messages_round_trip() {
    for message in client_messages() {
        let bytes = encode_client(&message).unwrap();
        let frame = Frame::parse(Bytes::from(bytes)).unwrap();
        assert_eq!(frame.into_client_message().unwrap(), Some(message));
    }
    for message in server_messages() {
        let bytes = encode_server(&message).unwrap();
        let frame = Frame::parse(Bytes::from(bytes)).unwrap();
        assert_eq!(frame.into_server_frame().unwrap(), Some(ServerFrame::Message(message)));
    }
    let frame = Frame::parse(Bytes::from(encode_piece(&piece()).unwrap())).unwrap();
    assert_eq!(frame.into_server_frame().unwrap(), Some(ServerFrame::Piece(piece())));
}

#[test]
fn every_truncation_and_every_extension_of_every_frame_is_refused() {
    for bytes in frames() {
        for length in 0..bytes.len() {
            let cut = Bytes::copy_from_slice(&bytes[..length]);
            assert_eq!(Frame::parse(cut), Err(FrameError::Truncated), "length {length} of {bytes:02x?}");
        }
        let longer: Vec<u8> = bytes.iter().copied().chain([0]).collect();
        assert_eq!(Frame::parse(Bytes::from(longer)), Err(FrameError::TrailingBytes(1)));
    }
}

#[test]
fn every_truncation_and_every_extension_of_every_body_is_refused() {
    for bytes in frames() {
        let frame = Frame::parse(Bytes::from(bytes)).unwrap();
        // A shorter piece is still valid; reassembly checks its length.
        if frame.tag == tag::PIECE {
            continue;
        }
        let from_client = frame.clone().into_client_message().is_ok_and(|m| m.is_some());
        let mut bodies: Vec<Bytes> = (0..frame.body.len()).map(|n| frame.body.slice(..n)).collect();
        bodies.push(frame.body.iter().copied().chain([0]).collect());
        for body in bodies {
            let changed = Frame { tag: frame.tag, body };
            if from_client {
                assert!(changed.clone().into_client_message().is_err(), "{changed:02x?}");
            } else {
                assert!(changed.clone().into_server_frame().is_err(), "{changed:02x?}");
            }
        }
    }
}

#[test]
fn unknown_messages_are_skipped_if_optional_and_refused_otherwise() {
    let optional = Frame::parse(Bytes::from_static(&[0x30 | OPTIONAL, 2, 1, 2])).unwrap();
    assert_eq!(optional.clone().into_client_message(), Ok(None));
    assert_eq!(optional.into_server_frame(), Ok(None));
    let required = Frame::parse(Bytes::from_static(&[0x30, 2, 1, 2])).unwrap();
    assert_eq!(required.clone().into_client_message(), Err(FrameError::UnknownTag(0x30)));
    assert_eq!(required.into_server_frame(), Err(FrameError::UnknownTag(0x30)));
}

#[test]
fn values_beyond_their_limits_are_neither_encoded_nor_decoded() {
    let wants = vec![Want::whole(BlobId::base(0), 0); MAX_IDS_PER_MESSAGE + 1];
    assert!(encode_client(&ClientMessage::Want(wants.clone())).is_err());
    // The same made by hand, past the encoder's check.
    let bytes = super::frame("Want", tag::WANT, &wants).unwrap();
    assert!(Frame::parse(Bytes::from(bytes)).unwrap().into_client_message().is_err());
    let ClientMessage::Hello(hello) = client_messages().remove(0) else { panic!("the first is Hello") };
    let greedy = Hello { have: vec![BlobId::base(0); MAX_HAVE + 1], ..hello.clone() };
    assert!(encode_client(&ClientMessage::Hello(greedy)).is_err());
    let blind = Hello { view: Some(View { eye: [f64::NAN; 3], ..view() }), ..hello };
    assert!(encode_client(&ClientMessage::Hello(blind)).is_err());
    let long = [tag::WANT, 0x80, 0x01, 0x00, 0x01];
    let error = Frame::parse(Bytes::copy_from_slice(&long)).unwrap_err();
    assert_eq!(error, FrameError::TooLong { bytes: 65_537, limit: MAX_MESSAGE_BYTES });
    assert_eq!(error.close_code(), CloseCode::Limit);
    let longer = [tag::WANT, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF];
    assert!(matches!(Frame::parse(Bytes::copy_from_slice(&longer)), Err(FrameError::TooLong { .. })));
    let beyond = BlobPiece { total: 10, ..piece() };
    assert!(encode_piece(&beyond).is_err());
    let empty = BlobPiece { bytes: Bytes::new(), ..piece() };
    assert!(encode_piece(&empty).is_err());
}

#[test]
fn forged_count_is_refused_before_memory_is_reserved() {
    // A `Want` that claims 2^32 − 1 entries in six bytes.
    let frame = Frame { tag: tag::WANT, body: Bytes::from_static(&[252, 0xFF, 0xFF, 0xFF, 0xFF, 0]) };
    assert!(matches!(frame.into_client_message(), Err(FrameError::Body { what: "Want", .. })));
}

#[test]
fn first_messages_are_short() {
    let hello = Hello { view: Some(view()), ..Hello::new("") };
    assert!(encode_client(&ClientMessage::Hello(hello)).unwrap().len() < 100);
    let scene = MemoryScene::new(1, 8, 2);
    let page = scene.page(0).unwrap();
    let bytes = encode_server(&ServerMessage::ScenePage((*page).clone())).unwrap().len();
    assert!(bytes < 80 + 8 * 15, "{bytes} bytes for one asset and eight instances");
}

#[test]
fn frames_are_the_same_however_the_stream_is_cut() {
    let stream: Vec<u8> = frames().concat();
    for step in [1, 2, 7, 100, stream.len()] {
        let mut reader = FrameReader::new();
        let mut found = Vec::new();
        for part in stream.chunks(step) {
            reader.push(part);
            while let Some(frame) = reader.next_frame().unwrap() {
                found.push(frame);
            }
        }
        assert_eq!(found.len(), frames().len());
        assert_eq!(reader.pending(), 0);
        for (frame, bytes) in found.into_iter().zip(frames()) {
            assert_eq!(frame, Frame::parse(Bytes::from(bytes)).unwrap());
        }
    }
}

proptest! {
    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let mut reader = FrameReader::new();
        reader.push(&bytes);
        while let Ok(Some(frame)) = reader.next_frame() {
            let _ = frame.clone().into_client_message();
            let _ = frame.into_server_frame();
        }
        prop_assert!(reader.pending() <= bytes.len());
    }

    #[test]
    fn random_bodies_never_panic(tag in any::<u8>(), body in prop::collection::vec(any::<u8>(), 0..200)) {
        let frame = Frame { tag, body: Bytes::from(body) };
        let _ = frame.clone().into_client_message();
        if let Ok(Some(ServerFrame::Piece(piece))) = frame.into_server_frame() {
            prop_assert!(u64::from(piece.offset) + piece.bytes.len() as u64 <= u64::from(piece.total));
        }
    }

    #[test]
    fn flipped_bits_never_panic(which in any::<prop::sample::Index>(), at in any::<prop::sample::Index>(), bit in 0..8_u8) {
        let frames = frames();
        let mut bytes = frames[which.index(frames.len())].clone();
        let at = at.index(bytes.len());
        bytes[at] ^= 1 << bit;
        if let Ok(frame) = Frame::parse(Bytes::from(bytes)) {
            let _ = frame.clone().into_client_message();
            let _ = frame.into_server_frame();
        }
    }
}
