//! Hostile bytes and deltas: errors, never panics, never partial changes.

use lodestream_geometry::base::{Base, MAX_CHUNKS};
use lodestream_geometry::index::{ChunkInfo, TruncationPoint, decode_page};
use lodestream_geometry::mesh::SourceMesh;
use lodestream_geometry::pack::{BlobKind, HEAD_BYTES, Head, write};
use lodestream_geometry::prepare::{Prepared, suit};
use lodestream_geometry::random::Random;
use lodestream_geometry::refine::{ActiveMesh, ChunkDelta, Id, Origin, RefineError, Repoint, Snapshot};
use lodestream_geometry::{Codec, Settings};
use proptest::prelude::*;

use crate::common::{prepared, quantised, regions, shapes, with_truncation_points};
use crate::invariants::deltas;

/// Small assets with all features: seams, materials, vertices without faces, non-manifold stars, colours, normals and two sets of
/// texture coordinates.
/// The range coder has all of them; codecs that only code the same values differently have those that add a value.
fn samples() -> Vec<Prepared> {
    let torus = shapes::materials(shapes::torus(9, 11), 3);
    let painted = shapes::painted(shapes::torus(7, 9));
    let parts = shapes::parts(shapes::height_field(16), 128);
    let lightmapped = shapes::lightmapped(shapes::torus(8, 10), 1);
    let small = [
        torus,
        painted,
        lightmapped,
        shapes::stones(6),
        shapes::fans(20),
        shapes::components(30),
        shapes::frigate(3),
        parts,
    ];
    let prepared = |codec, shapes: &[SourceMesh]| {
        let settings = Settings { codec, ..regions(50) };
        let of = |source| {
            let mut mesh = quantised(source);
            suit(&mut mesh, codec);
            prepared(&mesh, &settings)
        };
        shapes.iter().map(of).collect::<Vec<_>>()
    };
    [
        prepared(Codec::Range, &small),
        prepared(Codec::AxisAligned, &small[..5]),
        prepared(Codec::Zstd, &small[..5]),
    ]
    .concat()
}

#[test]
fn the_samples_cover_isolated_vertices_and_seams() {
    let samples = samples();
    let deltas: Vec<Vec<ChunkDelta>> = samples.iter().map(|asset| deltas(asset).1).collect();
    assert!(deltas.iter().all(|d| d.len() >= 2), "{:?}", deltas.iter().map(Vec::len).collect::<Vec<_>>());
    let all = || deltas.iter().flatten();
    assert!(
        all().any(|d| d.vertices.iter().any(|v| matches!(v.origin, Origin::Part(_)))),
        "no vertices without faces"
    );
    assert!(all().any(|d| d.wedges.len() > d.vertices.len()), "no seams");
    assert!(all().any(|d| d.faces.iter().any(|f| f.material > 0)), "no materials");
}

/// Every truncation, every single flipped bit, and random replacements of bytes.
fn damaged(bytes: &[u8], visit: &mut dyn FnMut(&[u8])) {
    for length in 0..bytes.len() {
        visit(&bytes[..length]);
    }
    let mut copy = bytes.to_vec();
    for at in 0..bytes.len() {
        for bit in 0..8 {
            copy[at] ^= 1 << bit;
            visit(&copy);
            copy[at] ^= 1 << bit;
        }
    }
    let mut random = Random::new(bytes.len() as u64);
    for _ in 0..200 {
        for _ in 0..1 + random.below(6) {
            copy[random.below(bytes.len())] = random.next_u64() as u8;
        }
        visit(&copy);
        copy.copy_from_slice(bytes);
    }
    copy.extend([0x5a; 40]);
    visit(&copy);
}

#[test]
fn damaged_base_blobs_give_errors_or_usable_meshes() {
    for asset in samples() {
        let mut refused = 0;
        damaged(&asset.base.encode().unwrap(), &mut |bytes| match Base::decode(bytes) {
            Ok(base) => {
                let mesh = ActiveMesh::new(&base);
                assert_eq!(mesh.face_count(), base.faces.len());
                assert_eq!(mesh.to_mesh().faces.len(), base.faces.len());
            }
            Err(_) => refused += 1,
        });
        assert!(refused > 100, "only {refused} refused");
    }
}

/// A claimed chunk count allocates little until chunks are applied.
#[test]
fn a_claim_of_four_million_chunks_holds_half_a_megabyte() {
    let mut base = samples().swap_remove(0).base;
    base.chunk_count = MAX_CHUNKS;
    let mut mesh = ActiveMesh::new(&base);
    let start = mesh.snapshot();
    assert!(mesh.bytes() < 1 << 20, "{} bytes", mesh.bytes());
    let last = ChunkDelta { chunk: MAX_CHUNKS - 1, ..ChunkDelta::default() };
    mesh.apply(&last).unwrap();
    assert!(mesh.is_applied(MAX_CHUNKS - 1) && !mesh.is_applied(u32::MAX));
    assert!(mesh.bytes() < 1 << 20, "{} bytes", mesh.bytes());
    mesh.undo(last.chunk).unwrap();
    assert!(mesh.snapshot() == start);
}

#[test]
fn damaged_index_pages_give_errors_or_entries_in_order() {
    for asset in samples() {
        for page in &asset.pages {
            damaged(page, &mut |bytes| {
                for (id, info) in decode_page(bytes, 0).unwrap_or_default().iter().enumerate() {
                    assert!(info.parents.iter().all(|&p| (p as usize) < id));
                    assert!(info.parents.is_sorted() && info.error >= 0.0 && info.error.is_finite());
                }
            });
        }
    }
}

/// Every delta that a decoder accepts can be applied and undone without trace, or is refused without one.
fn check_harmless(mesh: &mut ActiveMesh, before: &Snapshot, delta: &ChunkDelta) {
    if mesh.apply(delta).is_ok() {
        mesh.undo(delta.chunk).unwrap();
    }
    assert!(mesh.snapshot() == *before);
}

#[test]
fn damaged_chunks_never_harm_the_mesh() {
    for asset in samples() {
        let mut mesh = ActiveMesh::new(&asset.base);
        for (id, info) in asset.infos.iter().enumerate() {
            let before = mesh.snapshot();
            damaged(&asset.chunks[id], &mut |bytes| {
                if let Ok(delta) = mesh.decode(id as u32, info, bytes) {
                    assert_eq!(delta.vertices.len() as u32, info.vertices);
                    check_harmless(&mut mesh, &before, &delta);
                }
            });
            assert!(mesh.snapshot() == before, "decoding changed the mesh");
            let delta = mesh.decode(id as u32, info, &asset.chunks[id]).unwrap();
            mesh.apply(&delta).unwrap();
        }
    }
}

#[test]
fn chunks_of_other_places_never_harm_the_mesh() {
    for asset in samples() {
        let last = asset.infos.len() as u32 - 1;
        let (base, infos) = (&asset.base, &asset.infos);
        let mut other = ActiveMesh::new(base);
        let before = other.snapshot();
        for (payload, info) in asset.chunks.iter().zip(infos) {
            // A valid payload against the wrong mesh, with an index entry without parents.
            let info = ChunkInfo { parents: Vec::new(), ..info.clone() };
            for id in [0, last / 2, last] {
                if let Ok(delta) = other.decode(id, &info, payload) {
                    check_harmless(&mut other, &before, &delta);
                }
            }
        }
    }
}

#[test]
fn false_index_entries_are_refused_in_bounded_work() {
    for asset in samples() {
        let id = asset.infos.len() as u32 / 2;
        let mut mesh = ActiveMesh::new(&asset.base);
        for (chunk, info) in asset.infos.iter().enumerate().take(id as usize) {
            let delta = mesh.decode(chunk as u32, info, &asset.chunks[chunk]).unwrap();
            mesh.apply(&delta).unwrap();
        }
        let (info, payload) = (&asset.infos[id as usize], &asset.chunks[id as usize]);
        let refused = |change: &dyn Fn(&mut ChunkInfo)| {
            let mut lie = info.clone();
            change(&mut lie);
            assert!(mesh.decode(id, &lie, payload).is_err(), "{lie:?}");
        };
        refused(&|i| i.vertices += 1);
        refused(&|i| i.vertices -= 1);
        refused(&|i| i.faces += 1);
        refused(&|i| i.faces = 0);
        refused(&|i| i.wedges = u32::MAX);
        refused(&|i| i.vertices = u32::MAX);
        refused(&|i| i.vertices = 1 << 17);
        refused(&|i| i.parents.push(id));
        refused(&|i| i.parents.push(u32::MAX));
        refused(&|i| i.parents = vec![id + 1]);
        assert!(mesh.decode(asset.base.chunk_count, info, payload).is_err());
        assert!(mesh.decode(u32::MAX, info, payload).is_err());
        assert!(mesh.decode(id, info, payload).is_ok());

        // Unlimited symbols from constant bytes.
        let greedy = ChunkInfo { vertices: 1 << 17, wedges: u32::MAX, faces: u32::MAX, ..info.clone() };
        for byte in [0x00, 0x55, 0xaa, 0xff] {
            for length in [0, 16, 4096] {
                assert!(mesh.decode(id, &greedy, &vec![byte; length]).is_err());
            }
        }
    }
}

/// An index without parents must not allow a chunk to be undone while others depend on it.
#[test]
fn an_index_without_parents_cannot_make_references_dangle() {
    let mut refused = 0;
    for asset in samples() {
        let (full, deltas) = deltas(&asset);
        let mut mesh = ActiveMesh::new(&asset.base);
        let mut blind = Vec::new();
        for (id, info) in asset.infos.iter().enumerate() {
            let info = ChunkInfo { parents: Vec::new(), ..info.clone() };
            let delta = mesh.decode(id as u32, &info, &asset.chunks[id]).unwrap();
            mesh.apply(&delta).unwrap();
            blind.push(delta);
        }
        let mut random = Random::new(6);
        for _ in 0..asset.infos.len() * 20 {
            let id = random.below(blind.len());
            if mesh.is_applied(id as u32) {
                match mesh.undo(id as u32) {
                    Err(RefineError::HasChildren { .. }) => refused += 1,
                    other => assert!(other.is_ok(), "{other:?}"),
                }
            } else {
                // May not fit while others are missing; must never be applied partially.
                let before = mesh.snapshot();
                if mesh.apply(&blind[id]).is_err() {
                    assert!(mesh.snapshot() == before);
                }
            }
            check_references(&mesh);
        }
        for (id, delta) in deltas.iter().enumerate() {
            if !mesh.is_applied(id as u32) {
                mesh.apply(delta).unwrap();
            }
        }
        assert!(mesh.snapshot() == full.snapshot());
    }
    assert!(refused > 0);
}

/// Every reference of a state is valid.
fn check_references(mesh: &ActiveMesh) {
    let state = mesh.snapshot();
    for wedge in &state.wedges {
        assert!(state.vertices.binary_search_by_key(&wedge.1, |v| v.0).is_ok(), "{wedge:?}");
    }
    for face in &state.faces {
        for wedge in face.1 {
            assert!(state.wedges.binary_search_by_key(&wedge, |w| w.0).is_ok(), "{face:?}");
        }
    }
}

#[test]
fn forged_deltas_are_refused_without_change() {
    let mut moved = 0;
    for asset in samples() {
        let deltas = deltas(&asset).1;
        let mut mesh = ActiveMesh::new(&asset.base);
        for delta in &deltas {
            let before = mesh.snapshot();
            let missing = [
                Id { owner: 0, index: u32::MAX },
                Id { owner: u32::MAX, index: 0 },
                Id { owner: delta.chunk + 2, index: 0 },
                Id { owner: delta.chunk + 1, index: u32::MAX },
            ];
            let refused = |mesh: &mut ActiveMesh, change: &dyn Fn(&mut ChunkDelta)| {
                let mut forged = delta.clone();
                change(&mut forged);
                if forged != *delta {
                    assert!(mesh.apply(&forged).is_err());
                    assert!(mesh.snapshot() == before);
                }
            };
            for part in [asset.base.part_count, u32::MAX] {
                refused(&mut mesh, &|d| d.vertices.iter_mut().for_each(|v| v.origin = Origin::Part(part)));
            }
            for id in missing {
                refused(&mut mesh, &|d| d.vertices.iter_mut().for_each(|v| v.origin = Origin::Split(id)));
                refused(&mut mesh, &|d| d.wedges.iter_mut().for_each(|w| w.vertex = id));
                refused(&mut mesh, &|d| d.faces.iter_mut().for_each(|f| f.wedges[1] = id));
                refused(&mut mesh, &|d| d.moves.iter_mut().for_each(|m| m.vertex = id));
                refused(&mut mesh, &|d| d.repoints.iter_mut().for_each(|r| r.face = id));
                refused(&mut mesh, &|d| d.repoints.iter_mut().for_each(|r| r.from = id));
                refused(&mut mesh, &|d| d.repoints.iter_mut().for_each(|r| r.to = id));
                refused(&mut mesh, &|d| d.chunk = id.owner.max(asset.base.chunk_count));
            }
            refused(&mut mesh, &|d| d.repoints.iter_mut().for_each(|r| r.corner = 3));
            // To the current wedge, and from a wedge that does not exist before: undoing would leave the corner
            // there.
            refused(&mut mesh, &|d| d.repoints.iter_mut().for_each(|r| r.to = r.from));
            refused(&mut mesh, &|d| d.repoints.iter_mut().for_each(|r| r.from = r.to));
            refused(&mut mesh, &|d| d.faces.iter_mut().for_each(|f| f.material = 999));
            // A corner twice, to one wedge or to two.
            refused(&mut mesh, &|d| d.repoints.extend(d.repoints.first().copied()));
            refused(&mut mesh, &|d| {
                if let (Some(&first), Some(last)) = (d.repoints.first(), d.repoints.last().map(|r| r.to)) {
                    d.repoints.push(Repoint { to: last, ..first });
                }
            });
            // A vertex twice, from a wrong position, or one that the chunk adds.
            refused(&mut mesh, &|d| d.moves.extend(d.moves.last().copied()));
            refused(&mut mesh, &|d| d.moves.iter_mut().for_each(|m| m.from[1] ^= 1));
            refused(&mut mesh, &|d| d.moves.iter_mut().for_each(|m| m.vertex.owner = d.chunk + 1));
            refused(&mut mesh, &|d| d.parents.push(d.chunk));
            refused(&mut mesh, &|d| d.parents.push(u32::MAX));
            mesh.apply(delta).unwrap();
            let after = mesh.snapshot();
            assert_eq!(mesh.apply(delta), Err(RefineError::AlreadyApplied(delta.chunk)));
            // Refused deltas left no undo records.
            mesh.undo(delta.chunk).unwrap();
            assert!(mesh.snapshot() == before);
            assert_eq!(mesh.undo(delta.chunk), Err(RefineError::NotApplied(delta.chunk)));
            mesh.apply(delta).unwrap();
            moved += delta.moves.len();
            assert!(mesh.snapshot() == after);
        }
    }
    assert!(moved > 100, "only {moved} vertices moved");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_are_never_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..600), first in any::<u32>()) {
        let _ = Base::decode(&bytes);
        let _ = decode_page(&bytes, first);
        if let Ok(head) = Head::parse(&bytes) {
            let _ = head.parse_table(&bytes[HEAD_BYTES.min(bytes.len())..], u64::from(first));
        }
        // A valid head of a base blob, then arbitrary bytes.
        let asset = prepared(&quantised(&shapes::cube(1.0)), &regions(50));
        let mut base = asset.base.encode().unwrap();
        let keep = base.len().min(90);
        base.truncate(keep);
        base.extend(&bytes);
        let _ = Base::decode(&base);
        let mut pack = write([1; 32], &[(BlobKind::Base, &base), (BlobKind::Chunk(0), &bytes)]).unwrap();
        let at = first as usize % pack.len();
        pack[at] ^= 0x10;
        if let Ok(head) = Head::parse(&pack) {
            let end = (HEAD_BYTES + head.table_bytes()).min(pack.len());
            if let Ok(entries) = head.parse_table(&pack[HEAD_BYTES..end], pack.len() as u64) {
                for e in entries {
                    let range = e.offset as usize..e.offset as usize + e.length as usize;
                    let damaged = range.contains(&at);
                    prop_assert_eq!(e.verify(&pack[range]).is_err(), damaged);
                }
            }
        }
    }
}

#[test]
fn random_payloads_are_never_a_panic() {
    let asset = prepared(&quantised(&shapes::materials(shapes::torus(20, 20), 3)), &regions(200));
    let mut random = Random::new(77);
    let mut mesh = ActiveMesh::new(&asset.base);
    for (id, info) in asset.infos.iter().enumerate() {
        let before = mesh.snapshot();
        for _ in 0..150 {
            let bytes: Vec<u8> = (0..random.below(300)).map(|_| random.next_u64() as u8).collect();
            let counts = ChunkInfo {
                vertices: random.below(6) as u32,
                wedges: random.below(12) as u32,
                faces: random.below(12) as u32,
                ..info.clone()
            };
            if let Ok(delta) = mesh.decode(id as u32, &counts, &bytes) {
                check_harmless(&mut mesh, &before, &delta);
            }
        }
        mesh.apply(&mesh.decode(id as u32, info, &asset.chunks[id]).unwrap()).unwrap();
    }
}

/// Vertices without faces precede any truncation point; a truncation point that states fewer is refused.
#[test]
fn isolated_vertices_beyond_a_truncation_point() {
    let asset = prepared(&quantised(&shapes::soup(700)), &with_truncation_points(300));
    let mesh = ActiveMesh::new(&asset.base);
    let mut tried = 0;
    for (chunk, info) in
        (0..).zip(&asset.infos).filter(|(_, i)| i.parents.is_empty() && !i.truncation_points.is_empty())
    {
        let payload = &asset.chunks[chunk as usize];
        let honest = mesh.decode_prefix(chunk, info, Some(0), payload).unwrap();
        assert!(honest.vertices.len() > 1);
        let mut info = info.clone();
        info.truncation_points[0] =
            TruncationPoint { vertices: 1, wedges: 0, faces: 0, ..info.truncation_points[0] };
        let why = mesh.decode_prefix(chunk, &info, Some(0), payload).unwrap_err().to_string();
        assert!(why.contains("1 vertices, 0 wedges and 0 faces were stated"), "{why}");
        tried += 1;
    }
    assert!(tried > 0);
}
