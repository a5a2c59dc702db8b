//! Grids by level: coarse levels use coarse grids, and finer levels add the omitted bits.

use lodestream_geometry::Settings;
use lodestream_geometry::ancestor_closed_cut::{Budget, lowest_error};
use lodestream_geometry::base::Base;
use lodestream_geometry::refine::{ActiveMesh, ChunkDelta, RefineError};

use crate::common::{prepared, quantised, regions, shapes};
use crate::invariants::deltas;

#[test]
fn coarse_levels_lie_on_coarse_grids_and_the_last_on_the_finest() {
    let mesh = quantised(&shapes::sphere(60, 90, 0.05));
    let asset = prepared(&mesh, &regions(200));
    let shifts = &asset.base.shifts;
    assert_eq!(shifts.len(), usize::from(asset.base.level_count) + 1);
    assert!(shifts[0] >= 4 && shifts.is_sorted_by(|a, b| a >= b) && shifts.last() == Some(&0), "{shifts:?}");
    assert!(asset.base.positions.iter().flatten().all(|x| x.trailing_zeros() >= shifts[0].into()));
    let deltas = deltas(&asset).1;
    let mut active = ActiveMesh::new(&asset.base);
    let mut on_own_grid = 0;
    for level in
        deltas.chunk_by(|a, b| asset.infos[a.chunk as usize].level == asset.infos[b.chunk as usize].level)
    {
        let shift = u32::from(shifts[usize::from(asset.infos[level[0].chunk as usize].level)]);
        let (mut there, mut brought) = (0, 0);
        for delta in level {
            active.apply(delta).unwrap();
            let positions = delta.vertices.iter().map(|v| v.position).chain(delta.moves.iter().map(|m| m.to));
            for position in positions {
                brought += 1;
                there += usize::from(position.iter().all(|x| x.trailing_zeros() >= shift));
            }
        }
        // Vertices with more bits are those that no finer chunk moves.
        assert!(there * 4 > brought, "{there} of {brought} on the grid that leaves out {shift} bits");
        on_own_grid += usize::from(shift > 0);
    }
    assert!(on_own_grid >= 2, "{shifts:?}");
}

#[test]
fn coarse_grids_need_fewer_bytes_for_an_error() {
    let mesh = quantised(&shapes::sphere(80, 120, 0.02));
    let bytes = |coarse_grid: f64| {
        let asset = prepared(&mesh, &Settings { coarse_grid, ..regions(500) });
        let base = asset.base.encode().unwrap().len() as u64;
        let pages: u64 = asset.pages.iter().map(|p| p.len() as u64).sum();
        // Of the diagonal, which is the same for both.
        [0.02, 0.01].map(|share| {
            let error = share * f64::from(asset.base.diagonal);
            lowest_error(&asset.base, &asset.infos, base + pages, Budget::Error(error)).bytes
        })
    };
    let (coarse, one) = (bytes(0.7), bytes(0.0));
    assert!((0..2).all(|i| coarse[i] * 100 < one[i] * 95), "{coarse:?} bytes instead of {one:?}");
}

#[test]
fn one_grid_moves_nothing() {
    let mesh = quantised(&shapes::torus(40, 70));
    let asset = prepared(&mesh, &Settings { coarse_grid: 0.0, ..regions(200) });
    assert!(asset.base.shifts.iter().all(|&s| s == 0));
    assert!(deltas(&asset).1.iter().all(|d| d.moves.is_empty()));
}

#[test]
fn grids_out_of_range_are_refused() {
    let mesh = quantised(&shapes::sphere(40, 60, 0.05));
    let bytes = prepared(&mesh, &regions(200)).base.encode().unwrap();
    // Version, bits, kinds, levels; then the grids.
    let with = |at: usize, byte: u8| {
        let mut forged = bytes.clone();
        forged[at] = byte;
        Base::decode(&forged)
    };
    let own = bytes[4] & 15;
    let last = 4 + usize::from(bytes[3].div_ceil(2));
    assert_ne!(bytes[last], 0);
    for (at, byte, why) in [
        (4, own | 15 << 4, "out of range"),
        (4, 15 | bytes[4] & 0xf0, "out of range"),
        (5, 0xff, "a grid is finer than the finest"),
        (last, 0, "its finest grid leaves out bits"),
    ] {
        let error = with(at, byte).unwrap_err().to_string();
        assert!(error.contains(why), "{error}");
    }
}

#[test]
fn chunks_that_move_a_vertex_are_undone_in_reverse_order() {
    let mesh = quantised(&shapes::sphere(60, 90, 0.05));
    let asset = prepared(&mesh, &regions(200));
    let deltas = deltas(&asset).1;
    let mut active = ActiveMesh::new(&asset.base);
    let (first, other) = (&deltas[0], deltas.last().unwrap());
    let moved = first.moves[0];
    active.apply(first).unwrap();
    let before = active.snapshot();
    // A chunk without parents in its index entry, although another has moved the vertex.
    let mut to = moved.to;
    to[0] ^= 1;
    let forged = ChunkDelta {
        chunk: other.chunk,
        moves: vec![lodestream_geometry::refine::MovedVertex { from: moved.to, to, ..moved }],
        ..ChunkDelta::default()
    };
    active.apply(&forged).unwrap();
    let refused = active.undo(first.chunk);
    assert!(
        matches!(refused, Err(RefineError::HasChildren { chunk, .. }) if chunk == first.chunk),
        "{refused:?}"
    );
    active.undo(forged.chunk).unwrap();
    assert!(active.snapshot() == before);
    active.undo(first.chunk).unwrap();
    assert!(active.snapshot() == ActiveMesh::new(&asset.base).snapshot());
}
