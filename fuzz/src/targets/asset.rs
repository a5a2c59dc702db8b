//! Packs, base blobs and chunks.

use lodestream_compress::{decode_base, decode_chunk};
use lodestream_geometry::DecodeError;
use lodestream_geometry::base::Base;
use lodestream_geometry::index::{CHUNKS_PER_PAGE, ChunkInfo, decode_page};
use lodestream_geometry::pack::{BlobKind, ENTRY_BYTES, Entry, HEAD_BYTES, Head};
use lodestream_geometry::refine::ActiveMesh;
use lodestream_scene::asset::TextureRegions;

use crate::fixtures;
use crate::input::Input;
use crate::meter::{Ceiling, within};

/// A pack: head, table, the hash of every blob, base mesh, index pages, chunks in order.
///
/// The bytes are read as they are and, since no mutation survives the hashes, again with corrected hashes.
pub fn pack_reader(data: &[u8]) -> bool {
    let plain = within(PACK, data.len(), || read_pack(data)).is_ok();
    let Some(fixed) = rehashed(data) else { return plain };
    within(PACK, data.len(), || read_pack(&fixed)).is_ok() | plain
}

/// The table has 48 bytes per entry in memory and 36 in the file; the rest is the base mesh and the chunks. A zstd
/// frame may expand 64 times (and to 64 KiB, whatever its length).
const PACK: Ceiling =
    Ceiling { base_bytes: 1 << 25, bytes_per_byte: 1 << 14, base_steps: 1 << 22, steps_per_byte: 1 << 17 };

fn read_pack(file: &[u8]) -> Result<(), DecodeError> {
    let head = Head::parse(&file[..file.len().min(HEAD_BYTES)])?;
    let end = (HEAD_BYTES + head.table_bytes()).min(file.len());
    let entries = head.parse_table(&file[HEAD_BYTES..end], file.len() as u64)?;
    let blob = |entry: &Entry| -> Result<&[u8], DecodeError> {
        // The table was checked against the length of the file.
        let bytes = &file[entry.offset as usize..][..entry.length as usize];
        entry.verify(bytes)?;
        Ok(bytes)
    };
    let (mut mesh, mut infos) = (None, Vec::<ChunkInfo>::new());
    for entry in &entries {
        let bytes = blob(entry)?;
        match entry.kind {
            BlobKind::Base => mesh = Some(ActiveMesh::new(&decode_base(bytes)?)),
            BlobKind::IndexPage(page) => {
                let first = (page as usize).saturating_mul(CHUNKS_PER_PAGE);
                let page = decode_page(bytes, u32::try_from(first).unwrap_or(u32::MAX))?;
                check_page(&page, first);
                if infos.len() == first {
                    infos.extend(page);
                }
            }
            BlobKind::Chunk(chunk) => {
                let (Some(mesh), Some(info)) = (&mut mesh, infos.get(chunk as usize)) else { continue };
                let delta = decode_chunk(mesh, chunk, info, bytes)?;
                mesh.apply(&delta).map_err(|e| DecodeError::new("chunk", e.to_string()))?;
            }
            BlobKind::TextureRegions => {
                let regions = TextureRegions::decode(bytes)
                    .map_err(|why| DecodeError::new("texture regions", why.to_string()))?;
                assert!(regions.encode().is_ok(), "decoded regions are encoded");
            }
            BlobKind::Texture { .. } | BlobKind::Tile { .. } | BlobKind::Settings => {}
        }
    }
    Ok(())
}

fn check_page(infos: &[ChunkInfo], first: usize) {
    assert!(infos.len() <= CHUNKS_PER_PAGE);
    for (i, info) in infos.iter().enumerate() {
        assert!(info.parents.is_sorted() && info.parents.iter().all(|&p| (p as usize) < first + i));
        assert!(info.error.is_finite() && info.error >= 0.0);
        assert!(info.sphere.radius.is_finite() && info.sphere.radius >= 0.0);
        assert!(info.sphere.center.iter().all(|x| x.is_finite()));
    }
}

/// The same pack with corrected hashes of table and blobs, as far as they lie within the file; `None` for input that is
/// too short to be a pack.
#[must_use]
pub fn rehashed(file: &[u8]) -> Option<Vec<u8>> {
    const COUNT_AT: usize = 12;
    const FINGERPRINT_AT: usize = 16;
    const HASH_AT: usize = HEAD_BYTES - 16;
    let mut file = file.to_vec();
    let count = u32::from_le_bytes(file.get(COUNT_AT..FINGERPRINT_AT)?.try_into().ok()?) as usize;
    let end = HEAD_BYTES.checked_add(count.checked_mul(ENTRY_BYTES)?)?;
    file.get(..end)?;
    for at in (HEAD_BYTES..end).step_by(ENTRY_BYTES) {
        let offset = u64::from_le_bytes(file[at + 8..at + 16].try_into().ok()?);
        let length = u32::from_le_bytes(file[at + 16..at + 20].try_into().ok()?);
        let range = usize::try_from(offset).ok().and_then(|o| Some(o..o.checked_add(length as usize)?));
        if let Some(hash) = range.and_then(|r| file.get(r)).map(blake3::hash) {
            file[at + 20..at + 36].copy_from_slice(&hash.as_bytes()[..16]);
        }
    }
    let mut head = blake3::Hasher::new();
    head.update(&file[FINGERPRINT_AT..HASH_AT]);
    head.update(&file[HEAD_BYTES..end]);
    file[HASH_AT..HEAD_BYTES].copy_from_slice(&head.finalize().as_bytes()[..16]);
    Some(file)
}

/// A base blob: an accepted one can be refined, drawn and encoded again.
pub fn base_decoder(data: &[u8]) -> bool {
    let Ok(base) = within(BASE, data.len(), || Base::decode(data)) else { return false };
    let mesh = within(BASE, data.len(), || ActiveMesh::new(&base));
    assert_eq!(mesh.face_count(), base.faces.len());
    assert_eq!(mesh.to_mesh().faces.len(), base.faces.len());
    drawable(&mesh);
    let again = Base::decode(&base.encode().expect("an accepted base is encoded"));
    let again = again.expect("an encoded base is accepted");
    assert_eq!((again.faces.len(), again.positions.len()), (base.faces.len(), base.positions.len()));
    true
}

/// Places of 2^22 chunks take 0.5 MB, index lists of 65,535 materials 4 MB. The rest is the mesh.
const BASE: Ceiling =
    Ceiling { base_bytes: 8 << 20, bytes_per_byte: 8192, base_steps: 1 << 16, steps_per_byte: 1 << 13 };

/// Whether everything that a renderer reads exists and is finite.
pub(super) fn drawable(mesh: &ActiveMesh) {
    let slots = mesh.wedge_slots();
    for slot in 0..slots {
        let vertex = mesh.render_vertex(slot);
        let numbers =
            vertex.position.iter().chain(&vertex.normal).chain(&vertex.uv).chain(&vertex.morph_from);
        assert!(numbers.into_iter().all(|x| x.is_finite()), "slot {slot}: {vertex:?}");
    }
    let mut faces = 0;
    for material in 0..mesh.material_count() {
        for triangle in mesh.indices(material) {
            assert!(triangle.iter().all(|&w| w < slots) || *triangle == [0; 3]);
            faces += usize::from(*triangle != [0; 3]);
        }
    }
    assert!(faces <= mesh.face_count(), "{faces} in the index lists, {} faces", mesh.face_count());
}

/// A chunk's payload against a prepared mesh: `asset · chunk (2) · flags · vertices (2) · wedges (2) · faces (2) ·
/// payload`. The flags select the true counts and parents, or the given counts without parents; a third flag cuts the
/// payload at the first truncation point.
pub fn chunk_decoder(data: &[u8]) -> bool {
    let mut input = Input::new(data);
    let fixtures = fixtures::all();
    let fixture = &fixtures[usize::from(input.u8()) % fixtures.len()];
    let chunk = input.choice(fixture.before.len());
    let flags = input.u8();
    let counts = [input.u16(), input.u16(), input.u16()].map(u32::from);
    let payload = input.rest();
    let mut info = fixture.asset.infos[chunk].clone();
    if flags & 1 == 0 {
        [info.vertices, info.wedges, info.faces] = counts;
    }
    if flags & 2 == 0 {
        info.parents.clear();
    }
    let mesh = &fixture.before[chunk];
    let truncation = (flags & 4 != 0 && !info.truncation_points.is_empty()).then_some(0);
    let decode = || mesh.decode_prefix(chunk as u32, &info, truncation, payload);
    let Ok(delta) = within(CHUNK, payload.len(), decode) else { return false };
    let extent = info.extent(truncation);
    assert_eq!(
        [delta.vertices.len(), delta.wedges.len(), delta.faces.len()].map(|n| n as u32),
        [extent.vertices, extent.wedges, extent.faces]
    );
    let mut active = mesh.clone();
    let before = mesh.snapshot();
    if active.apply(&delta).is_ok() {
        drawable(&active);
        active.undo(chunk as u32).expect("what was applied can be undone");
    }
    assert!(active.snapshot() == before, "a chunk left a trace");
    true
}

/// The region is gathered from a mesh of some hundred faces; what a chunk adds is proportional to its bits.
const CHUNK: Ceiling =
    Ceiling { base_bytes: 1 << 20, bytes_per_byte: 8192, base_steps: 1 << 18, steps_per_byte: 1 << 17 };
