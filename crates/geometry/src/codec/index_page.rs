//! Index pages: the entries of up to 64 chunks, each coded as differences from the previous one.

use crate::asset::index::{
    CHUNKS_PER_PAGE, ChunkInfo, IndexPage, MAX_PARENTS, MAX_TRUNCATION_POINTS, Sphere, TruncationPoint,
};
use crate::asset::screen::visible_error;
use crate::codec::model::{
    INDEX_ATTRIBUTE, INDEX_BYTES, INDEX_ERROR, INDEX_FACES, INDEX_FIRST_PARENT, INDEX_LEVEL,
    INDEX_NEXT_PARENT, INDEX_PARENTS, INDEX_RADIUS, INDEX_STOP_BYTES, INDEX_STOP_ERROR, INDEX_STOP_FACES,
    INDEX_STOP_VERTICES, INDEX_STOP_WEDGES, INDEX_STOPS, INDEX_VERTICES, INDEX_WEDGES, contexts,
};
use crate::entropy::range_coder::{Coder, Decoder, Encoder};
use crate::entropy::symbols::{integer, signed};
use crate::error::DecodeError;
use crate::numbers::{id32, truncated};

/// Encodes the entries of one page: about 12 bytes per chunk.
///
/// Centres are snapped to a grid over the page's box and radii increased accordingly; radii and errors are rounded up
/// to 8 significant bits (by 0.8 % at most). So spheres and errors remain bounds, and a parent's error remains at
/// least its child's. [`decode_page`] returns the rounded values.
///
/// # Errors
/// More than [`CHUNKS_PER_PAGE`] chunks, [`MAX_PARENTS`] parents or [`MAX_TRUNCATION_POINTS`] truncation points,
/// lengths that are not finite, and parents that are not ascending or not older than their child.
pub fn encode_page(infos: &[ChunkInfo], first: u32) -> Result<Vec<u8>, DecodeError> {
    let mut encoder = Encoder::new(contexts());
    code_page(&mut encoder, first, Some(infos))?;
    Ok(encoder.finish(0))
}

/// Encodes the entries of all chunks of an asset. Returns the pages, and the entries as [`decode_page`] returns them.
///
/// A page states the largest error of the later chunks if [`expected_rest_error`] does not bound it.
///
/// # Errors
/// As [`encode_page`].
pub fn encode_pages(infos: &[ChunkInfo]) -> Result<(Vec<Vec<u8>>, Vec<ChunkInfo>), DecodeError> {
    let mut pages = Vec::new();
    // Errors are compared after rounding, as clients see them.
    let mut seen: Vec<ChunkInfo> = Vec::with_capacity(infos.len());
    for page in infos.chunks(CHUNKS_PER_PAGE) {
        let first = id32(seen.len());
        let bytes = encode_page(page, first)?;
        seen.extend(decode_page(&bytes, first)?);
        pages.push(bytes);
    }
    let mut rest_error = 0.0_f32;
    for (number, page) in pages.iter_mut().enumerate().rev() {
        let first = number * CHUNKS_PER_PAGE;
        let end = seen.len().min(first + CHUNKS_PER_PAGE);
        if rest_error > expected_rest_error(&seen[..end]) {
            let mut encoder = Encoder::new(contexts());
            let stated = Some(rest_error);
            code_stated_page(&mut encoder, id32(first), Some(&infos[first..end]), stated)?;
            *page = encoder.finish(0);
        }
        let errors = seen[first..end].iter().map(|info| visible_error(info, 1.0));
        rest_error = errors.fold(rest_error, f32::max);
    }
    Ok((pages, seen))
}

/// Upper bound on the visible error of later chunks that follows from the first pages, unless the last of these pages
/// states a bound.
///
/// A chunk's error is at most that of any of its parents. Chunks are numbered level by level, and parents usually lie
/// in the previous level, so the bound is the largest error among the last two levels. If a region had no chunks in
/// some levels, parents lie further up, and the page states the bound.
#[must_use]
pub fn expected_rest_error<'a>(known: impl IntoIterator<Item = &'a ChunkInfo, IntoIter: Clone>) -> f32 {
    let known = known.into_iter();
    let Some(last) = known.clone().last() else { return f32::MAX };
    known
        .filter(|info| info.level.saturating_add(1) >= last.level)
        .map(|info| visible_error(info, 1.0))
        .fold(0.0, f32::max)
}

/// Decodes one index page with the bound that it states; see [`decode_page`].
///
/// # Errors
/// As [`decode_page`].
pub fn decode_stated_page(bytes: &[u8], first: u32) -> Result<IndexPage, DecodeError> {
    let mut decoder = Decoder::new(contexts(), bytes);
    let page = code_stated_page(&mut decoder, first, None, None)?;
    decoder.end(0)?;
    Ok(page)
}

/// Decodes the chunks of one index page, as sent on the wire.
///
/// `first` is the id of the page's first chunk (`page × CHUNKS_PER_PAGE`).
///
/// # Errors
/// For truncated pages, counts beyond [`CHUNKS_PER_PAGE`], parents that are not older than their child, truncation
/// points that are not ascending, and values that are not finite.
pub fn decode_page(bytes: &[u8], first: u32) -> Result<Vec<ChunkInfo>, DecodeError> {
    decode_stated_page(bytes, first).map(|page| page.chunks)
}

/// Codes the chunks of a page with any coder: encodes `infos` if given, and returns what a decoder reads.
pub(crate) fn code_page<C: Coder>(
    coder: &mut C,
    first: u32,
    infos: Option<&[ChunkInfo]>,
) -> Result<Vec<ChunkInfo>, DecodeError> {
    code_stated_page(coder, first, infos, None).map(|page| page.chunks)
}

/// Coded in place of the number of chunks if the page is full and states a bound on later errors. Only a full page
/// has successors.
const FULL_WITH_BOUND: u32 = 65;
const _: () = assert!(FULL_WITH_BOUND as usize == CHUNKS_PER_PAGE + 1);

fn code_stated_page<C: Coder>(
    coder: &mut C,
    first: u32,
    infos: Option<&[ChunkInfo]>,
    stated: Option<f32>,
) -> Result<IndexPage, DecodeError> {
    if let Some(infos) = infos {
        check_encodable(infos, first)?;
    }
    let count = infos.map_or(0, |i| id32(i.len()));
    let count = coder.raw(7, if stated.is_some() { FULL_WITH_BOUND } else { count });
    let mut rest_error = None;
    if count == FULL_WITH_BOUND {
        let stated = length_of(coder.raw(15, stated.map_or(0, length_code)));
        if !stated.is_finite() {
            return Err(page_error("the error behind a page is not finite"));
        }
        rest_error = Some(stated);
    }
    let count = if count == FULL_WITH_BOUND { CHUNKS_PER_PAGE } else { count as usize };
    if count > CHUNKS_PER_PAGE {
        return Err(page_error(format!("{count} chunks; a page has {CHUNKS_PER_PAGE}")));
    }
    if count == 0 {
        return coder.check().map(|()| IndexPage::default());
    }
    let grid = CenterGrid::code(coder, infos)?;
    let mut page = Vec::with_capacity(count);
    let mut previous = ChunkInfo::default();
    for i in 0..count {
        let id = first.checked_add(id32(i)).ok_or_else(|| page_error("a chunk id is out of range"))?;
        let info = code_info(coder, &grid, id, &previous, infos.map(|all| &all[i]))?;
        coder.check()?;
        page.push(info.clone());
        previous = info;
    }
    Ok(IndexPage { chunks: page, rest_error })
}

fn page_error(why: impl Into<String>) -> DecodeError {
    DecodeError::new("index page", why)
}

fn check_encodable(infos: &[ChunkInfo], first: u32) -> Result<(), DecodeError> {
    if infos.len() > CHUNKS_PER_PAGE {
        return Err(page_error(format!("{} chunks; a page has {CHUNKS_PER_PAGE}", infos.len())));
    }
    for (id, info) in (first..).zip(infos) {
        let lengths =
            info.sphere.center.iter().chain([&info.sphere.radius, &info.error, &info.attribute_error]);
        if !lengths.chain(info.truncation_points.iter().map(|s| &s.error)).all(|x| x.is_finite()) {
            return Err(page_error(format!("a length of chunk {id} is not finite")));
        }
        let ascending =
            info.parents.is_sorted_by(|a, b| a < b) && info.parents.last().is_none_or(|&p| p < id);
        if !ascending || info.parents.len() > MAX_PARENTS {
            return Err(page_error(format!(
                "chunk {id} has {} parents, up to {:?}; at most {MAX_PARENTS} older ones are possible",
                info.parents.len(),
                info.parents.last()
            )));
        }
        if info.truncation_points.len() > MAX_TRUNCATION_POINTS {
            return Err(page_error(format!(
                "chunk {id} has {} truncation points; at most {MAX_TRUNCATION_POINTS} are possible",
                info.truncation_points.len()
            )));
        }
    }
    Ok(())
}

/// Bits per axis of a centre.
const CENTER_BITS: u32 = 11;
/// Largest cell of an axis.
const TOP_CELL: u16 = (1 << CENTER_BITS) - 1;

/// The grid of a page's centres.
struct CenterGrid {
    origin: [f32; 3],
    step: f32,
}

impl CenterGrid {
    fn code<C: Coder>(coder: &mut C, infos: Option<&[ChunkInfo]>) -> Result<Self, DecodeError> {
        let (mut origin, mut step) = ([0.0; 3], 0.0_f32);
        if let Some(infos) = infos {
            let (mut min, mut max) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
            for info in infos {
                for k in 0..3 {
                    min[k] = min[k].min(info.sphere.center[k]);
                    max[k] = max[k].max(info.sphere.center[k]);
                }
            }
            let extent = (0..3).map(|k| max[k] - min[k]).fold(0.0, f32::max);
            (origin, step) = (min, rounded_up(extent / f32::from(TOP_CELL)));
        }
        let mut number = |x: f32| f32::from_bits(coder.raw(32, x.to_bits()));
        let origin = origin.map(&mut number);
        let step = number(step);
        if !origin.iter().chain([&step]).all(|x| x.is_finite()) || step < 0.0 {
            return Err(page_error("a number is not finite"));
        }
        Ok(Self { origin, step })
    }

    fn snap(&self, center: [f32; 3]) -> [u32; 3] {
        let top = f32::from(TOP_CELL);
        [0, 1, 2].map(|k| {
            if self.step > 0.0 {
                let cell = ((center[k] - self.origin[k]) / self.step).round().clamp(0.0, top);
                truncated(cell.into()).unsigned_abs()
            } else {
                0
            }
        })
    }

    fn center(&self, cell: [u32; 3]) -> [f32; 3] {
        [0, 1, 2].map(|k| self.origin[k] + self.step * f32::from(u16::try_from(cell[k]).unwrap_or(TOP_CELL)))
    }
}

/// Mantissa bits that lengths lose.
const LOST_BITS: u32 = 16;

/// Code of the smallest length of 8 significant bits that is at least `x`.
fn length_code(x: f32) -> u32 {
    let most = f32::MAX.to_bits() >> LOST_BITS;
    (x.max(0.0).to_bits().saturating_add((1 << LOST_BITS) - 1) >> LOST_BITS).min(most)
}

fn length_of(code: u32) -> f32 {
    f32::from_bits(code << LOST_BITS)
}

fn rounded_up(x: f32) -> f32 {
    length_of(length_code(x))
}

/// Codes a length, rounded up, as a difference from another.
fn code_length<C: Coder>(coder: &mut C, at: usize, near: f32, want: Option<f32>) -> Result<f32, DecodeError> {
    let near = length_code(near).cast_signed();
    let got = near.wrapping_add(signed(coder, at, want.map_or(0, |x| length_code(x).cast_signed() - near)));
    let length = u32::try_from(got).ok().filter(|&c| c <= f32::MAX.to_bits() >> LOST_BITS).map(length_of);
    length.ok_or_else(|| page_error("a length is out of range"))
}

/// Codes a count as a difference from a prediction.
fn code_count<C: Coder>(coder: &mut C, at: usize, guess: u32, want: Option<u32>) -> Result<u32, DecodeError> {
    let guess = guess.min(MAX_COUNT);
    let got = signed(coder, at, want.map_or(0, |x| x.min(MAX_COUNT).cast_signed() - guess.cast_signed()));
    guess
        .checked_add_signed(got)
        .filter(|&c| c <= MAX_COUNT)
        .ok_or_else(|| page_error("a count is out of range"))
}

/// Largest byte or element count of an entry.
const MAX_COUNT: u32 = (1 << 29) - 1;

fn code_info<C: Coder>(
    coder: &mut C,
    grid: &CenterGrid,
    id: u32,
    previous: &ChunkInfo,
    want: Option<&ChunkInfo>,
) -> Result<ChunkInfo, DecodeError> {
    let rise =
        integer(coder, INDEX_LEVEL, want.map_or(0, |w| u32::from(w.level.wrapping_sub(previous.level))));
    let level =
        u8::try_from(rise).map_err(|_| page_error("a level is out of range"))?.wrapping_add(previous.level);
    let cell = want.map_or([0; 3], |w| grid.snap(w.sphere.center)).map(|x| coder.raw(CENTER_BITS, x));
    let center = grid.center(cell);
    if !center.iter().all(|x| x.is_finite()) {
        return Err(page_error("a centre is out of range"));
    }
    let radius = want.map(|w| {
        let moved: f32 = (0..3).map(|k| (center[k] - w.sphere.center[k]).abs()).sum();
        w.sphere.radius + moved
    });
    let radius = code_length(coder, INDEX_RADIUS, previous.sphere.radius, radius)?;
    let error = code_length(coder, INDEX_ERROR, previous.error, want.map(|w| w.error))?;
    let attribute_error =
        code_length(coder, INDEX_ATTRIBUTE, previous.attribute_error, want.map(|w| w.attribute_error))?;
    let parents = code_parents(coder, id, want.map(|w| w.parents.as_slice()))?;
    let vertices = code_count(coder, INDEX_VERTICES, previous.vertices, want.map(|w| w.vertices))?;
    let wedges = code_count(coder, INDEX_WEDGES, vertices, want.map(|w| w.wedges))?;
    let faces = code_count(coder, INDEX_FACES, vertices.saturating_mul(2), want.map(|w| w.faces))?;
    let bytes = share(previous.payload_bytes, vertices, previous.vertices);
    let payload_bytes = code_count(coder, INDEX_BYTES, bytes, want.map(|w| w.payload_bytes))?;
    let mut info = ChunkInfo {
        level,
        sphere: Sphere { center, radius },
        error,
        attribute_error,
        truncation_points: Vec::new(),
        parents,
        payload_bytes,
        vertices,
        wedges,
        faces,
    };
    info.truncation_points = code_truncation_points(
        coder,
        &info,
        id32(previous.truncation_points.len()),
        want.map(|w| w.truncation_points.as_slice()),
    )?;
    Ok(info)
}

/// `whole × part / of`, without overflow; `whole` if `of` is 0.
fn share(whole: u32, part: u32, of: u32) -> u32 {
    (u64::from(whole) * u64::from(part))
        .checked_div(u64::from(of))
        .map_or(whole, |x| u32::try_from(x).map_or(MAX_COUNT, |x| x.min(MAX_COUNT)))
}

fn code_parents<C: Coder>(coder: &mut C, id: u32, want: Option<&[u32]>) -> Result<Vec<u32>, DecodeError> {
    let count = integer(coder, INDEX_PARENTS, want.map_or(0, |w| id32(w.len()))) as usize;
    if count > MAX_PARENTS.min(id as usize) {
        return Err(page_error(format!("chunk {id} has {count} parents")));
    }
    let mut parents = Vec::with_capacity(count.min(64));
    // The first parent is coded as distance from the chunk, the others as distance from the previous one.
    for i in 0..count {
        let parent = if i == 0 {
            let back = integer(coder, INDEX_FIRST_PARENT, want.map_or(0, |w| id - w[0]));
            id.checked_sub(back).filter(|_| back > 0)
        } else {
            let before: u32 = parents[i - 1];
            let gap = integer(coder, INDEX_NEXT_PARENT, want.map_or(0, |w| w[i] - before - 1));
            before.checked_add(gap).and_then(|p| p.checked_add(1)).filter(|&p| p < id)
        };
        parents.push(parent.ok_or_else(|| page_error(format!("chunk {id} has a parent out of order")))?);
        coder.check()?;
    }
    Ok(parents)
}

/// Codes truncation points, each predicted as its share of the whole chunk.
fn code_truncation_points<C: Coder>(
    coder: &mut C,
    info: &ChunkInfo,
    before: u32,
    want: Option<&[TruncationPoint]>,
) -> Result<Vec<TruncationPoint>, DecodeError> {
    let count = code_count(coder, INDEX_STOPS, before, want.map(|w| id32(w.len())))?;
    if count as usize > MAX_TRUNCATION_POINTS {
        return Err(page_error(format!("{count} truncation points in one chunk")));
    }
    let mut truncation_points: Vec<TruncationPoint> = Vec::with_capacity(count as usize);
    for i in 0..count {
        let want = want.map(|w| w[i as usize]);
        let guess = share(info.vertices, i + 1, count + 1);
        let vertices = code_count(coder, INDEX_STOP_VERTICES, guess, want.map(|w| w.vertices))?;
        let wedges = code_count(
            coder,
            INDEX_STOP_WEDGES,
            share(info.wedges, vertices, info.vertices),
            want.map(|w| w.wedges),
        )?;
        let faces = code_count(
            coder,
            INDEX_STOP_FACES,
            share(info.faces, vertices, info.vertices),
            want.map(|w| w.faces),
        )?;
        let guess = share(info.payload_bytes, vertices, info.vertices);
        let payload_bytes = code_count(coder, INDEX_STOP_BYTES, guess, want.map(|w| w.payload_bytes))?;
        let near = truncation_points.last().map_or(info.error, |s| s.error);
        let error = code_length(coder, INDEX_STOP_ERROR, near, want.map(|w| w.error))?;
        let truncation = TruncationPoint { payload_bytes, error, vertices, wedges, faces };
        let last = truncation_points.last().copied().unwrap_or_default();
        let ascends = last.vertices <= vertices && last.wedges <= wedges && last.faces <= faces;
        let ends = vertices <= info.vertices && wedges <= info.wedges && faces <= info.faces;
        if !ascends || !ends || last.payload_bytes > payload_bytes || payload_bytes > info.payload_bytes {
            return Err(page_error("truncation points are out of order"));
        }
        truncation_points.push(truncation);
    }
    Ok(truncation_points)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunk(level: u8, error: f32, parents: Vec<u32>) -> ChunkInfo {
        ChunkInfo {
            level,
            error,
            parents,
            payload_bytes: 900,
            vertices: 300,
            faces: 600,
            ..ChunkInfo::default()
        }
    }

    #[test]
    fn pages_state_a_bound_only_if_it_does_not_follow() {
        let mut infos = vec![chunk(1, 1.0, vec![]), chunk(1, 0.5, vec![])];
        infos.extend((2..64).map(|_| chunk(2, 0.25, vec![1])));
        infos.extend((64..130).map(|_| chunk(3, 0.125, vec![2])));
        let (pages, seen) = encode_pages(&infos).unwrap();
        for (number, page) in pages.iter().enumerate() {
            let first = number * CHUNKS_PER_PAGE;
            let end = infos.len().min(first + CHUNKS_PER_PAGE);
            assert_eq!(*page, encode_page(&infos[first..end], first as u32).unwrap());
            let decoded = decode_stated_page(page, first as u32).unwrap();
            assert_eq!((&decoded.chunks[..], decoded.rest_error), (&seen[first..end], None));
        }
        // The last chunk's parent is the first chunk, so its error does not follow from the second page.
        infos[129] = chunk(5, 0.75, vec![0]);
        let (stating, seen) = encode_pages(&infos).unwrap();
        assert_eq!(stating[0], pages[0], "its own chunks bound what follows");
        let second = decode_stated_page(&stating[1], 64).unwrap();
        assert_eq!((&second.chunks[..], second.rest_error), (&seen[64..128], Some(seen[129].error)));
        assert!(stating[1].len() <= pages[1].len() + 3);
        for length in 0..stating[1].len() {
            let cut = decode_stated_page(&stating[1][..length], 64);
            assert_ne!(cut.ok().as_ref(), Some(&second), "length {length}");
        }
    }

    #[test]
    fn a_stated_error_that_is_not_finite_is_refused() {
        let mut encoder = Encoder::new(contexts());
        encoder.raw(7, FULL_WITH_BOUND);
        encoder.raw(15, 0x7F80);
        assert!(decode_stated_page(&encoder.finish(0), 0).unwrap_err().to_string().contains("not finite"));
    }
}
