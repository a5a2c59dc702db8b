//! Serialisation of a finished level's chunks for checkpoints. Not an interchange format: read only by the program
//! that wrote it, so numbers are stored uncompressed, which is fastest.

use crate::collapse::{Collapse, MovedCorner, NO_VERTEX, Placed, Records, RemovedFace};
use crate::entropy::bytes::Reader;
use crate::error::DecodeError;
use crate::mesh::{Attributes, Wedge};
use crate::simplify::hierarchy::RegionChunk;

/// Serialises the chunks of one block.
pub(crate) fn pack(chunks: &[RegionChunk]) -> Vec<u8> {
    let mut out = Vec::with_capacity(chunks.iter().map(bytes_of).sum());
    for chunk in chunks {
        let records = &chunk.records;
        put(&mut out, &records.collapses, |c| {
            [c.removed, c.target, c.moved_end, c.removed_end, c.added_wedges_end]
        });
        put(&mut out, &records.moved, |m| [m.face, m.from, m.to]);
        put(&mut out, &records.removed, |r| [r.face, r.third().unwrap_or(NO_VERTEX)]);
        put(&mut out, &records.removed_wedges, |&wedges| wedges);
        put(&mut out, &records.added_wedges, |&k| [k]);
        put(&mut out, &records.truncation_points, |&s| [s]);
        put(&mut out, &chunk.faces, |&f| [f]);
        put(&mut out, &chunk.interior, |&v| [v]);
        put(&mut out, &chunk.truncation_errors, |&e| halves(e));
        put(&mut out, &chunk.moves, |m| {
            let [x, y, z] = m.cell.map(i32::cast_unsigned);
            [m.vertex, x, y, z, m.shift.into()]
        });
        put(&mut out, &[records.first_added_wedge], |&k| [k]);
        let [x, y, z] = chunk.center;
        let reals = [records.reach, chunk.error, chunk.attribute_error, x, y, z, chunk.radius];
        put(&mut out, &reals, |&x| halves(x));
    }
    out
}

/// Parses `count` chunks written by [`pack`].
///
/// # Errors
/// If the bytes are damaged.
pub(crate) fn unpack(bytes: &[u8], count: usize) -> Result<Vec<RegionChunk>, DecodeError> {
    let mut r = Reader::new(bytes, "checkpoint chunks");
    let chunks = (0..count).map(|_| chunk(&mut r)).collect::<Result<_, _>>()?;
    if r.remaining() > 0 { Err(r.error("it has trailing bytes")) } else { Ok(chunks) }
}

fn chunk(r: &mut Reader<'_>) -> Result<RegionChunk, DecodeError> {
    let collapses = list(r, |[removed, target, moved_end, removed_end, added_wedges_end]| Collapse {
        removed,
        target,
        moved_end,
        removed_end,
        added_wedges_end,
    })?;
    let moved = list(r, |[face, from, to]| MovedCorner { face, from, to })?;
    let removed = list(r, |[face, third]| RemovedFace::new(face, (third != NO_VERTEX).then_some(third)))?;
    let removed_wedges = list(r, |wedges| wedges)?;
    let (added_wedges, truncation_points) = (list(r, |[k]| k)?, list(r, |[s]| s)?);
    let (faces, interior) = (list(r, |[f]| f)?, list(r, |[v]| v)?);
    let truncation_errors = list(r, real)?;
    let moves = list(r, |[vertex, x, y, z, shift]| Placed {
        vertex,
        cell: [x, y, z].map(u32::cast_signed),
        shift: shift as u8,
    })?;
    let first_added_wedge = list(r, |[k]| k)?.first().copied().unwrap_or_default();
    let reals = list(r, real)?;
    let &[reach, error, attribute_error, x, y, z, radius] = reals.as_slice() else {
        return Err(r.error("a chunk lacks values"));
    };
    let ends = |c: &Collapse| [c.moved_end, c.removed_end, c.added_wedges_end];
    let lengths = [moved.len(), removed.len(), added_wedges.len()];
    let within = collapses.iter().all(|c| (0..3).all(|k| ends(c)[k] as usize <= lengths[k]));
    let rising = collapses.windows(2).all(|c| (0..3).all(|k| ends(&c[0])[k] <= ends(&c[1])[k]));
    if !within
        || removed_wedges.len() != removed.len()
        || !rising
        || truncation_points.iter().any(|&s| s as usize > collapses.len())
    {
        return Err(r.error("its lists have inconsistent lengths"));
    }
    let records = Records {
        collapses,
        costs: Vec::new(),
        moved,
        removed,
        removed_wedges,
        added_wedges,
        first_added_wedge,
        truncation_points,
        reach,
    };
    let center = [x, y, z];
    Ok(RegionChunk {
        records,
        faces,
        interior,
        error,
        attribute_error,
        truncation_errors,
        moves,
        center,
        radius,
    })
}

/// Estimated length of a chunk.
fn bytes_of(chunk: &RegionChunk) -> usize {
    let records = &chunk.records;
    let words = 5 * records.collapses.len()
        + 3 * records.moved.len()
        + 5 * records.removed.len()
        + records.added_wedges.len()
        + chunk.faces.len()
        + chunk.interior.len()
        + 5 * chunk.moves.len();
    4 * words + 160 + 12 * records.truncation_points.len()
}

/// Appends a list of entries of `N` words each.
pub(super) fn put<T, const N: usize>(out: &mut Vec<u8>, list: &[T], words: impl Fn(&T) -> [u32; N]) {
    out.extend((list.len() as u32).to_le_bytes());
    for entry in list {
        out.extend(words(entry).iter().flat_map(|word| word.to_le_bytes()));
    }
}

/// Parses a list written by [`put`].
pub(super) fn list<T, const N: usize>(
    r: &mut Reader<'_>,
    entry: impl Fn([u32; N]) -> T,
) -> Result<Vec<T>, DecodeError> {
    let count = u32::from_le_bytes(r.array()?) as usize;
    let bytes = r.take(count.saturating_mul(4 * N))?;
    let word = |at: &[u8]| at.iter().rev().fold(0, |word, &byte| word << 8 | u32::from(byte));
    Ok(bytes
        .chunks_exact(4 * N)
        .map(|at| entry(std::array::from_fn(|k| word(&at[4 * k..4 * k + 4]))))
        .collect())
}

/// Appends wedges.
pub(super) fn put_wedges(out: &mut Vec<u8>, wedges: &[Wedge]) {
    put(out, wedges, |w| {
        let Attributes { uv, group, color, normal, second_uv } = w.attributes;
        let [u, v] = uv.map(i32::cast_unsigned);
        let halves = |[x, y]: [u16; 2]| u32::from(x) << 16 | u32::from(y);
        let (has_normal, normal) = (normal.is_some().into(), halves(normal.unwrap_or_default()));
        [w.vertex, u, v, group, u32::from_le_bytes(color), has_normal, normal, halves(second_uv)]
    });
}

/// Parses wedges written by [`put_wedges`].
pub(super) fn wedges(r: &mut Reader<'_>) -> Result<Vec<Wedge>, DecodeError> {
    let halves = |word: u32| [(word >> 16) as u16, word as u16];
    list(r, |[vertex, u, v, group, color, has_normal, normal, second_uv]| Wedge {
        vertex,
        attributes: Attributes {
            uv: [u, v].map(u32::cast_signed),
            group,
            color: color.to_le_bytes(),
            normal: (has_normal != 0).then_some(halves(normal)),
            second_uv: halves(second_uv),
        },
    })
}

pub(super) fn halves(x: f64) -> [u32; 2] {
    let bits = x.to_bits();
    [bits as u32, (bits >> 32) as u32]
}

pub(super) fn real([low, high]: [u32; 2]) -> f64 {
    f64::from_bits(u64::from(high) << 32 | u64::from(low))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checkpoint::InMemoryCheckpoint;
    use crate::common;
    use crate::pool::{MonitoredPool, Serial, Silent};
    use crate::simplify::simplify;

    #[test]
    fn chunks_round_trip_and_prefixes_are_rejected() {
        let checkpoint = InMemoryCheckpoint::default();
        let mut taken = 0;
        for (name, source) in common::all() {
            let mesh = common::quantised(&source);
            let mut pool = MonitoredPool::new(&Serial, &Silent, mesh.faces.len());
            let chunks = simplify(&mesh, &common::regions(400), &mut pool, &checkpoint).unwrap().levels.all();
            let bytes = pack(&chunks);
            assert!(unpack(&bytes, chunks.len()).unwrap() == chunks, "{name}");
            if let Some(chunk) = chunks.last() {
                let bytes = pack(std::slice::from_ref(chunk));
                assert!(
                    (0..bytes.len()).step_by(7).all(|length| unpack(&bytes[..length], 1).is_err()),
                    "{name}"
                );
                assert!(unpack(&bytes, 2).is_err());
                taken += 1;
            }
        }
        assert!(taken > 10, "only {taken} meshes have chunks");
    }
}
