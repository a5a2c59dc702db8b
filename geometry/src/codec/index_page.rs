//! Index pages: the entries of up to 64 chunks, each said by how it differs from the one before.

use crate::asset::index::{CHUNKS_PER_PAGE, ChunkInfo, MAX_PARENTS, MAX_STOPS, Sphere, Stop};
use crate::codec::model::{
    INDEX_ATTRIBUTE, INDEX_BYTES, INDEX_ERROR, INDEX_FACES, INDEX_FIRST_PARENT, INDEX_LEVEL,
    INDEX_NEXT_PARENT, INDEX_PARENTS, INDEX_RADIUS, INDEX_STOP_BYTES, INDEX_STOP_ERROR, INDEX_STOP_FACES,
    INDEX_STOP_VERTICES, INDEX_STOP_WEDGES, INDEX_STOPS, INDEX_VERTICES, INDEX_WEDGES, contexts,
};
use crate::entropy::range_coder::{Coder, Decoder, Encoder};
use crate::entropy::symbols::{integer, signed};
use crate::error::DecodeError;
use crate::numbers::{id32, truncated};

/// Encodes the entries of one page: about 12 bytes a chunk.
///
/// Centres are snapped to a grid over the page's box and radii raised by what that moves them; radii and
/// errors are rounded up to 8 significant bits (by 0.8 % at most). So spheres and errors still bound, and a
/// parent's error still is not below its child's. [`decode_page`] tells what became of them.
///
/// # Errors
/// On more than [`CHUNKS_PER_PAGE`] chunks, [`MAX_PARENTS`] parents or [`MAX_STOPS`] stops, on lengths that are not finite, and
/// on parents that are not ascending and older than their child.
pub fn encode_page(infos: &[ChunkInfo], first: u32) -> Result<Vec<u8>, DecodeError> {
    let mut encoder = Encoder::new(contexts());
    code_page(&mut encoder, first, Some(infos))?;
    Ok(encoder.finish(0))
}

/// Decodes one index page, as sent on the wire.
///
/// `first` is the id of the page's first chunk (`page × CHUNKS_PER_PAGE`).
///
/// # Errors
/// Refuses truncated pages, counts beyond [`CHUNKS_PER_PAGE`], parents that are not older than their
/// child, stops that are not ascending, and values that are not finite.
pub fn decode_page(bytes: &[u8], first: u32) -> Result<Vec<ChunkInfo>, DecodeError> {
    let mut decoder = Decoder::new(contexts(), bytes);
    let page = code_page(&mut decoder, first, None)?;
    decoder.end(0)?;
    Ok(page)
}

/// Codes a page with any coder: says `infos` if given, and answers what a decoder hears.
pub(crate) fn code_page<C: Coder>(
    coder: &mut C,
    first: u32,
    infos: Option<&[ChunkInfo]>,
) -> Result<Vec<ChunkInfo>, DecodeError> {
    if let Some(infos) = infos {
        may_be_coded(infos, first)?;
    }
    let count = coder.raw(7, infos.map_or(0, |i| id32(i.len()))) as usize;
    if count > CHUNKS_PER_PAGE {
        return Err(fail(format!("{count} chunks; a page has {CHUNKS_PER_PAGE}")));
    }
    if count == 0 {
        return coder.check().map(|()| Vec::new());
    }
    let grid = CenterGrid::code(coder, infos)?;
    let mut page = Vec::with_capacity(count);
    let mut previous = ChunkInfo::default();
    for i in 0..count {
        let id = first.checked_add(id32(i)).ok_or_else(|| fail("a chunk id is out of range"))?;
        let info = code_info(coder, &grid, id, &previous, infos.map(|all| &all[i]))?;
        coder.check()?;
        page.push(info.clone());
        previous = info;
    }
    Ok(page)
}

fn fail(why: impl Into<String>) -> DecodeError {
    DecodeError::new("index page", why)
}

fn may_be_coded(infos: &[ChunkInfo], first: u32) -> Result<(), DecodeError> {
    if infos.len() > CHUNKS_PER_PAGE {
        return Err(fail(format!("{} chunks; a page has {CHUNKS_PER_PAGE}", infos.len())));
    }
    for (id, info) in (first..).zip(infos) {
        let lengths =
            info.sphere.center.iter().chain([&info.sphere.radius, &info.error, &info.attribute_error]);
        if !lengths.chain(info.stops.iter().map(|s| &s.error)).all(|x| x.is_finite()) {
            return Err(fail(format!("a length of chunk {id} is not finite")));
        }
        let ascending =
            info.parents.is_sorted_by(|a, b| a < b) && info.parents.last().is_none_or(|&p| p < id);
        if !ascending || info.parents.len() > MAX_PARENTS {
            return Err(fail(format!(
                "chunk {id} has {} parents, up to {:?}; at most {MAX_PARENTS} older ones can be said",
                info.parents.len(),
                info.parents.last()
            )));
        }
        if info.stops.len() > MAX_STOPS {
            return Err(fail(format!(
                "chunk {id} has {} stops; at most {MAX_STOPS} can be said",
                info.stops.len()
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
            (origin, step) = (min, raise(extent / f32::from(TOP_CELL)));
        }
        let mut number = |x: f32| f32::from_bits(coder.raw(32, x.to_bits()));
        let origin = origin.map(&mut number);
        let step = number(step);
        if !origin.iter().chain([&step]).all(|x| x.is_finite()) || step < 0.0 {
            return Err(fail("a number is not finite"));
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

/// Bits of a float's mantissa that lengths lose.
const LOST_BITS: u32 = 16;

/// The code of the least length of 8 significant bits that is not below `x`.
fn length_code(x: f32) -> u32 {
    let most = f32::MAX.to_bits() >> LOST_BITS;
    (x.max(0.0).to_bits().saturating_add((1 << LOST_BITS) - 1) >> LOST_BITS).min(most)
}

fn length_of(code: u32) -> f32 {
    f32::from_bits(code << LOST_BITS)
}

fn raise(x: f32) -> f32 {
    length_of(length_code(x))
}

/// Codes a length, rounded up, by its difference from another.
fn code_length<C: Coder>(coder: &mut C, at: usize, near: f32, want: Option<f32>) -> Result<f32, DecodeError> {
    let near = length_code(near).cast_signed();
    let got = near.wrapping_add(signed(coder, at, want.map_or(0, |x| length_code(x).cast_signed() - near)));
    let length = u32::try_from(got).ok().filter(|&c| c <= f32::MAX.to_bits() >> LOST_BITS).map(length_of);
    length.ok_or_else(|| fail("a length is out of range"))
}

/// Codes a count by its difference from a guess.
fn code_count<C: Coder>(coder: &mut C, at: usize, guess: u32, want: Option<u32>) -> Result<u32, DecodeError> {
    let guess = guess.min(MAX_COUNT);
    let got = signed(coder, at, want.map_or(0, |x| x.min(MAX_COUNT).cast_signed() - guess.cast_signed()));
    guess.checked_add_signed(got).filter(|&c| c <= MAX_COUNT).ok_or_else(|| fail("a count is out of range"))
}

/// Most bytes or elements that an entry can say.
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
    let level = u8::try_from(rise).map_err(|_| fail("a level is out of range"))?.wrapping_add(previous.level);
    let cell = want.map_or([0; 3], |w| grid.snap(w.sphere.center)).map(|x| coder.raw(CENTER_BITS, x));
    let center = grid.center(cell);
    if !center.iter().all(|x| x.is_finite()) {
        return Err(fail("a centre is out of range"));
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
        stops: Vec::new(),
        parents,
        payload_bytes,
        vertices,
        wedges,
        faces,
    };
    info.stops = code_stops(coder, &info, id32(previous.stops.len()), want.map(|w| w.stops.as_slice()))?;
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
        return Err(fail(format!("chunk {id} has {count} parents")));
    }
    let mut parents = Vec::with_capacity(count.min(64));
    // The first counts back from the chunk, the others on from the one before.
    for i in 0..count {
        let parent = if i == 0 {
            let back = integer(coder, INDEX_FIRST_PARENT, want.map_or(0, |w| id - w[0]));
            id.checked_sub(back).filter(|_| back > 0)
        } else {
            let before: u32 = parents[i - 1];
            let gap = integer(coder, INDEX_NEXT_PARENT, want.map_or(0, |w| w[i] - before - 1));
            before.checked_add(gap).and_then(|p| p.checked_add(1)).filter(|&p| p < id)
        };
        parents.push(parent.ok_or_else(|| fail(format!("chunk {id} has a parent out of order")))?);
        coder.check()?;
    }
    Ok(parents)
}

/// Stops, each expected at its share of what the whole chunk adds.
fn code_stops<C: Coder>(
    coder: &mut C,
    info: &ChunkInfo,
    before: u32,
    want: Option<&[Stop]>,
) -> Result<Vec<Stop>, DecodeError> {
    let count = code_count(coder, INDEX_STOPS, before, want.map(|w| id32(w.len())))?;
    if count as usize > MAX_STOPS {
        return Err(fail(format!("{count} stops in one chunk")));
    }
    let mut stops: Vec<Stop> = Vec::with_capacity(count as usize);
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
        let near = stops.last().map_or(info.error, |s| s.error);
        let error = code_length(coder, INDEX_STOP_ERROR, near, want.map(|w| w.error))?;
        let stop = Stop { payload_bytes, error, vertices, wedges, faces };
        let last = stops.last().copied().unwrap_or_default();
        let ascends = last.vertices <= vertices && last.wedges <= wedges && last.faces <= faces;
        let ends = vertices <= info.vertices && wedges <= info.wedges && faces <= info.faces;
        if !ascends || !ends || last.payload_bytes > payload_bytes || payload_bytes > info.payload_bytes {
            return Err(fail("stops are out of order"));
        }
        stops.push(stop);
    }
    Ok(stops)
}
