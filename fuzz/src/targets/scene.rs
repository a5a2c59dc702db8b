//! A published scene: read whole, as a daemon does, and in ranges, as a client does.

use bytes::Bytes;
use lodestream_client::ranges::{ContentRange, Object, RangeSession, RangeSettings, ResponseHead};
use lodestream_protocol::client::{ClientConfig, ClientEvent};
use lodestream_protocol::time::Time;
use lodestream_scene::blob::BlobId;
use lodestream_scene::encoding;
use lodestream_scene::published::{
    Behind, HEAD_BYTES, Head, Opening, PageRecord, Part, SourceRecord, part_hash,
};
use lodestream_select::{State, Wanted};
use lodestream_store::SceneObject;

use crate::meter::{Ceiling, within};

/// Reads the bytes as they are, and again with corrected hashes. An accepted scene is encoded to the same bytes.
pub fn scene_object(data: &[u8]) -> bool {
    let plain = within(SCENE, data.len(), || read(data));
    let sealed = rehashed(data);
    within(SCENE, sealed.len(), || read(&sealed)) | plain
}

/// Reads the bytes in ranges, as they are and with corrected hashes, and requests blobs of every kind.
pub fn range_session(data: &[u8]) -> bool {
    let plain = within(SCENE, data.len(), || read_in_ranges(data));
    let sealed = rehashed(data);
    within(SCENE, sealed.len(), || read_in_ranges(&sealed)) | plain
}

/// Decoding reserves 32 bytes per byte, in steps that may be sixteen times as large; validation and encoding as much
/// again.
const SCENE: Ceiling =
    Ceiling { base_bytes: 1 << 20, bytes_per_byte: 1 << 11, base_steps: 1 << 20, steps_per_byte: 1 << 12 };

fn read(bytes: &[u8]) -> bool {
    let Ok(object) = SceneObject::decode(&Bytes::copy_from_slice(bytes)) else { return false };
    let again = object.encode().expect("what was read can be written");
    let twice = SceneObject::decode(&again.clone().into()).expect("what was written can be read");
    assert_eq!(twice.encode().as_ref(), Ok(&again), "a scene is another after it was written");
    true
}

/// Corrects the hashes of the opening and of the records that it lists, as far as they can be read.
fn rehashed(data: &[u8]) -> Vec<u8> {
    let mut bytes = data.to_vec();
    let Some(length) = bytes.get(12..16).and_then(|length| length.try_into().ok()).map(u32::from_le_bytes)
    else {
        return bytes;
    };
    let Some(start) = HEAD_BYTES.checked_add(length as usize).filter(|start| *start <= bytes.len()) else {
        return bytes;
    };
    let total = bytes.len() as u64;
    bytes[16..24].copy_from_slice(&total.to_le_bytes());
    let opening = Head::parse(&bytes).and_then(|_| Opening::decode(&bytes[HEAD_BYTES..start]));
    if let Ok(mut opening) = opening {
        let mut body = bytes[start..].to_vec();
        for place in &mut opening.pages {
            rehash_page(&mut body, &place.page);
            rehash_source(&mut body, &place.source);
            rehash(&body, &mut place.page);
            rehash(&body, &mut place.source);
        }
        let lists = [
            &mut opening.terrain_directory,
            &mut opening.terrain_tables,
            &mut opening.light_directory,
            &mut opening.light_tables,
            &mut opening.parts.directory,
            &mut opening.parts.tables,
            &mut opening.animations,
        ];
        lists.into_iter().flatten().for_each(|part| rehash(&body, part));
        if let Ok(encoded) = encoding::encode(&opening)
            && encoded.len() == length as usize
        {
            bytes[HEAD_BYTES..start].copy_from_slice(&encoded);
            bytes[start..].copy_from_slice(&body);
        }
    }
    let hash = blake3::hash(&bytes[HEAD_BYTES..start]);
    bytes[24..40].copy_from_slice(&hash.as_bytes()[..16]);
    bytes
}

fn range(part: &Part) -> Option<std::ops::Range<usize>> {
    Some(usize::try_from(part.offset).ok()?..usize::try_from(part.end()).ok()?)
}

fn rehash(body: &[u8], part: &mut Part) {
    if let Some(bytes) = range(part).and_then(|range| body.get(range)) {
        part.hash = part_hash(bytes);
    }
}

fn rehash_page(body: &mut [u8], part: &Part) {
    let Some(place) = range(part).filter(|range| range.end <= body.len()) else { return };
    let Ok(mut record) = encoding::decode::<PageRecord>(&body[place.clone()], 1 << 20) else { return };
    let mut bases: Vec<Part> = record.bases(part).collect();
    bases.iter_mut().for_each(|base| rehash(body, base));
    record.bases = bases.iter().map(|base| base.hash).collect();
    put(body, place, encoding::encode(&record).ok());
}

fn rehash_source(body: &mut [u8], part: &Part) {
    let Some(place) = range(part).filter(|range| range.end <= body.len()) else { return };
    let Ok(mut record) = encoding::decode::<SourceRecord>(&body[place.clone()], 1 << 20) else { return };
    let behind: Vec<_> = record.behind(part).collect();
    for (asset, behind, mut part) in behind {
        rehash(body, &mut part);
        let asset = &mut record.assets[asset];
        match behind {
            Behind::Index(page, _) => asset.index[page as usize].hash = part.hash,
            Behind::Tiles(_) => asset.tiles.iter_mut().for_each(|place| place.hash = part.hash),
            Behind::Texture(place) => {
                asset
                    .coarse
                    .iter_mut()
                    .filter(|other| **other == place)
                    .for_each(|other| other.hash = part.hash);
            }
        }
    }
    put(body, place, encoding::encode(&record).ok());
}

/// Replaces a record by one of the same length.
fn put(body: &mut [u8], place: std::ops::Range<usize>, record: Option<Vec<u8>>) {
    if let Some(record) = record.filter(|record| record.len() == place.len()) {
        body[place].copy_from_slice(&record);
    }
}

/// Blobs of every kind, some of which no scene has.
fn wanted() -> Vec<Wanted> {
    let mut ids = Vec::new();
    for n in [0, 1, 2, 63, 64, 5000, u32::MAX] {
        ids.extend([
            BlobId::base(n),
            BlobId::index_page(0, n),
            BlobId::index_page(n, 0),
            BlobId::chunk(0, n),
        ]);
        ids.extend([BlobId::chunk(n, 0), BlobId::texture(n, 0, 0), BlobId::texture(0, 0, 1)]);
        ids.extend([BlobId::terrain_page(n), BlobId::height_overrides(n)]);
        ids.extend([BlobId::punctual_light_directory(n), BlobId::punctual_light_page(n)]);
        ids.extend([BlobId::part_directory(n), BlobId::part_page(n), BlobId::Animation(n)]);
    }
    ids.sort_unstable();
    ids.dedup();
    let whole = |(n, id)| Wanted::whole(id, n, None, State::Absent);
    (1..).zip(ids).map(whole).collect()
}

/// Most requests that are answered.
const MAX_REQUESTS: u64 = 64;

fn read_in_ranges(object: &[u8]) -> bool {
    let mut now = Time::ZERO;
    let mut session = RangeSession::new(ClientConfig::default(), RangeSettings::default(), None, false, now);
    let wanted = wanted();
    let mut opened = false;
    while session.requests() < MAX_REQUESTS && !session.is_closed() {
        let Some(request) = session.poll_request(now) else { break };
        now = now + std::time::Duration::from_millis(10);
        let total = match request.object {
            Object::Scene => object.len() as u64,
            Object::Pack(_, bytes) => bytes,
        };
        let range = request.range.start..request.range.end.min(total);
        let content_range =
            (!range.is_empty()).then(|| ContentRange { range: range.clone(), total: Some(total) });
        let status = if range.is_empty() { 416 } else { 206 };
        session.handle_head(now, request.id, &ResponseHead { status, content_range, encoded: false });
        let place = usize::try_from(range.start).unwrap_or(0)..usize::try_from(range.end).unwrap_or(0);
        // Packs are as long as their scene says, so only their first bytes are made up.
        let made_up = vec![0; place.len().min(4096)];
        let body = match request.object {
            Object::Scene => object.get(place).unwrap_or_default(),
            Object::Pack(..) => &made_up,
        };
        for piece in body.chunks(1000) {
            session.handle_body(now, request.id, piece);
        }
        session.handle_end(now, request.id);
        session.handle_timeout(now);
        while let Some(event) = session.poll_event() {
            if let ClientEvent::Blob { offset, total, bytes, .. } = &event {
                assert!(*offset as usize + bytes.len() <= *total as usize, "{event:?}");
            }
            opened |= matches!(event, ClientEvent::Connected(_));
        }
        session.set_wanted(now, &wanted, &[]);
    }
    opened
}
