//! The wire form of one patch's height overrides.
//!
//! Positions are relative to their lattice (the greatest common divisors of columns and rows) and coded as a bit mask
//! over its cells, with the neighbouring bits as context (as in JBIG, ITU-T T.82), or as horizontal runs, whichever
//! is smaller. Heights are in units of their greatest common divisor, predicted from overridden neighbours to the
//! left and above; the residuals' contexts are their neighbours' residuals. All symbols use the adaptive range coder.
//!
//! ```text
//! one range-coded stream: layout | modes | count | lattice (first column and row, steps, columns, rows) |
//! positions | first height, step of heights | for each point by row and column: mode if mixed, residual
//! ```
//!
//! An empty list has no bytes.

use super::error::TerrainError;
use super::mode::Mode;
use super::override_prediction::Predictor;
use super::points::{HeightOverride, HeightOverrides, MAX_PATCH_POINTS};
use lodestream_geometry::DecodeError;
use lodestream_geometry::entropy::allocation_limit::{max_elements, min_bytes};
use lodestream_geometry::entropy::context::{Contexts, Prob};
use lodestream_geometry::entropy::range_coder::{Coder, Decoder, Encoder};
use lodestream_geometry::entropy::symbols::{
    INTEGER_CONTEXTS, integer, tree, tree_contexts, unzigzag, zigzag,
};
use lodestream_geometry::numbers::{id32, low32};

/// Most mask cells per point: beyond it runs are smaller, and a decoder's work stays proportional to its input.
const MASK_CELLS: u64 = 64;
/// Mask cells allowed in addition.
const MASK_FREE_CELLS: u64 = 1024;

/// Context bits of a mask.
const MASK_BITS: u32 = 10;
/// Classes of prediction uncertainty.
const UNCERTAINTIES: usize = 12;
/// Bits of a residual's class: magnitudes of up to 32 bits.
const CLASS_BITS: u32 = 6;
const RESIDUAL_CONTEXTS: usize = tree_contexts(CLASS_BITS) + 2 * 33;

// First contexts.
const COUNT: usize = 0;
const LATTICE: usize = COUNT + INTEGER_CONTEXTS;
const RUNS: usize = LATTICE + INTEGER_CONTEXTS;
const MASK: usize = RUNS + 4 * INTEGER_CONTEXTS;
const MODES: usize = MASK + (1 << MASK_BITS);
const RESIDUALS: usize = MODES + 2;
const CONTEXTS: usize = RESIDUALS + UNCERTAINTIES * RESIDUAL_CONTEXTS;

fn contexts() -> Contexts {
    Contexts { probs: vec![Prob::default(); CONTEXTS], weights: Vec::new() }
}

/// The lattice that contains all points.
#[derive(Clone, Copy, Debug, Default)]
struct Lattice {
    first: [u32; 2],
    step: [u32; 2],
    cells: [u32; 2],
}

impl Lattice {
    fn of(points: &[HeightOverride]) -> Self {
        let axis = |of: fn(&HeightOverride) -> u16| {
            let low = points.iter().map(of).min().unwrap_or(0);
            let high = points.iter().map(of).max().unwrap_or(0);
            let step = points.iter().fold(0, |step, p| gcd(step, u32::from(of(p) - low))).max(1);
            (u32::from(low), step, u32::from(high - low) / step + 1)
        };
        let (x, y) = (axis(|p| p.x), axis(|p| p.y));
        Self { first: [x.0, y.0], step: [x.1, y.1], cells: [x.2, y.2] }
    }

    fn code<C: Coder>(&self, coder: &mut C, side: u32) -> Result<Self, DecodeError> {
        let mut got = Self::default();
        for axis in 0..2 {
            got.first[axis] = integer(coder, LATTICE, self.first[axis]);
            got.cells[axis] = integer(coder, LATTICE, self.cells[axis]);
            got.step[axis] = integer(coder, LATTICE, self.step[axis]);
            let [first, cells, step] = [got.first, got.cells, got.step].map(|of| u64::from(of[axis]));
            // All three are below 2^31.
            if cells == 0 || step == 0 || first + (cells - 1) * step > u64::from(side) {
                return Err(error("positions are outside the patch"));
            }
        }
        Ok(got)
    }

    fn area(&self) -> u64 {
        u64::from(self.cells[0]) * u64::from(self.cells[1])
    }

    /// The lattice cell of a point.
    fn cell(&self, point: &HeightOverride) -> [u32; 2] {
        [0, 1].map(|axis| (u32::from([point.x, point.y][axis]) - self.first[axis]) / self.step[axis])
    }
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

fn error(why: impl Into<String>) -> DecodeError {
    DecodeError::new("terrain points", why)
}

/// Encodes the height overrides of a patch of `finest_level`; no bytes for an empty list.
///
/// # Errors
/// If a point is outside such a patch.
pub fn encode_points(finest_level: u8, points: &HeightOverrides) -> Result<Vec<u8>, TerrainError> {
    let side = 1_u16 << finest_level.min(15);
    let list = points.as_slice();
    if let Some(p) = list.iter().find(|p| p.x > side || p.y > side) {
        return Err(TerrainError::BadPoint { x: p.x, y: p.y, why: "is outside the patch" });
    }
    if list.is_empty() {
        return Ok(Vec::new());
    }
    let lattice = Lattice::of(list);
    let masks = lattice.area() <= MASK_CELLS * list.len() as u64 + MASK_FREE_CELLS;
    let encode = |mask: bool| {
        let mut encoder = Encoder::new(contexts());
        let least = min_bytes(list.len() as u64);
        // An encoder cannot fail.
        let _ = code(&mut encoder, finest_level, u64::MAX, Some(list), mask, lattice);
        encoder.finish(least)
    };
    let runs = encode(false);
    Ok(if masks { Some(encode(true)).filter(|mask| mask.len() <= runs.len()).unwrap_or(runs) } else { runs })
}

/// Decodes the result of [`encode_points`] for a patch of `finest_level`. Memory and work are bounded by the input:
/// at most 16 points per byte plus 64.
///
/// # Errors
/// If the bytes are not height overrides of such a patch.
pub fn decode_points(finest_level: u8, bytes: &[u8]) -> Result<HeightOverrides, DecodeError> {
    let points = if bytes.is_empty() {
        Vec::new()
    } else {
        let mut decoder = Decoder::new(contexts(), bytes);
        let limit = max_elements(bytes.len()).min(MAX_PATCH_POINTS as u64);
        let points = code(&mut decoder, finest_level, limit, None, false, Lattice::default())?;
        decoder.end(min_bytes(points.len() as u64))?;
        points
    };
    HeightOverrides::new(finest_level, points).map_err(|e| error(e.to_string()))
}

/// Codes height overrides; `list` is `None` for a decoder.
fn code<C: Coder>(
    coder: &mut C,
    finest_level: u8,
    limit: u64,
    list: Option<&[HeightOverride]>,
    mask: bool,
    lattice: Lattice,
) -> Result<Vec<HeightOverride>, DecodeError> {
    let overrides = list.unwrap_or_default();
    let side = 1_u32 << finest_level.min(15);
    let mask = coder.raw(1, u32::from(mask)) == 1;
    let fixed = overrides.iter().filter(|p| p.mode == Mode::Fixed).count();
    // 0: all additive, 1: all fixed, 2: a flag per point.
    let modes = if fixed == 0 { 0 } else { 1 + u32::from(fixed < overrides.len()) };
    let modes = coder.raw(2, modes);
    let count = integer(coder, COUNT, id32(overrides.len()));
    if modes > 2 || count == 0 {
        return Err(error("a list without points, or of unknown kind"));
    }
    if u64::from(count) > limit {
        return Err(error(format!("{count} points, its bytes allow {limit}")));
    }
    let lattice = lattice.code(coder, side)?;
    if u64::from(count) > lattice.area() {
        return Err(error(format!("{count} points in {} places", lattice.area())));
    }
    let cells: Vec<[u32; 2]> = overrides.iter().map(|p| lattice.cell(p)).collect();
    let given_cells = list.map(|_| cells.as_slice());
    let cells = if mask {
        if lattice.area() > MASK_CELLS * u64::from(count) + MASK_FREE_CELLS {
            return Err(error(format!("a mask of {} places for {count} points", lattice.area())));
        }
        code_mask(coder, lattice, count as usize, given_cells)?
    } else {
        code_runs(coder, lattice, count as usize, given_cells)?
    };
    coder.check()?;
    code_heights(coder, lattice, &cells, modes, list)
}

/// Codes the cells of the lattice that have an override.
fn code_mask<C: Coder>(
    coder: &mut C,
    lattice: Lattice,
    count: usize,
    overrides: Option<&[[u32; 2]]>,
) -> Result<Vec<[u32; 2]>, DecodeError> {
    let width = lattice.cells[0] as usize;
    let mut left = overrides.unwrap_or_default().iter().copied().peekable();
    let mut cells = Vec::with_capacity(count);
    // Three rows, with two empty columns on either side.
    let mut rows: [Vec<bool>; 3] = std::array::from_fn(|_| vec![false; width + 4]);
    for y in 0..lattice.cells[1] {
        rows.rotate_right(1);
        rows[0].fill(false);
        for x in 0..width {
            let [row, above, top] = &rows;
            let around = row[x..x + 2].iter().chain(&above[x..x + 5]).chain(&top[x + 1..x + 4]);
            let context = around.fold(0, |context, &bit| context << 1 | usize::from(bit));
            let cell = [id32(x), y];
            let listed = coder.bit(MASK + context, left.next_if_eq(&cell).is_some());
            rows[0][x + 2] = listed;
            if listed {
                if cells.len() == count {
                    return Err(error(format!("more than {count} places in a mask")));
                }
                cells.push(cell);
            }
        }
    }
    if cells.len() == count {
        Ok(cells)
    } else {
        Err(error(format!("{} of {count} places in a mask", cells.len())))
    }
}

/// Codes the overridden cells as horizontal runs, by row and column.
fn code_runs<C: Coder>(
    coder: &mut C,
    lattice: Lattice,
    count: usize,
    overrides: Option<&[[u32; 2]]>,
) -> Result<Vec<[u32; 2]>, DecodeError> {
    let overrides = overrides.unwrap_or_default();
    let [width, height] = lattice.cells;
    let mut cells: Vec<[u32; 2]> = Vec::with_capacity(count);
    // Row, first column and end of the last run.
    let (mut y, mut start, mut end) = (0_u32, 0_u32, 0_u32);
    while cells.len() < count {
        let rest = &overrides[cells.len().min(overrides.len())..];
        let [next_x, next_y] = rest.first().copied().unwrap_or_default();
        let length = rest.iter().zip(0..).take_while(|&(&cell, i)| cell == [next_x + i, next_y]).count();
        let down = integer(coder, RUNS, next_y.wrapping_sub(y));
        let (row, column) = if down > 0 {
            // Close to the start of the last run.
            let shift = zigzag(next_x.wrapping_sub(start).cast_signed());
            let shift = unzigzag(integer(coder, RUNS + INTEGER_CONTEXTS, shift));
            (u64::from(y) + u64::from(down), i64::from(start) + i64::from(shift))
        } else {
            let gap = integer(coder, RUNS + 2 * INTEGER_CONTEXTS, next_x.wrapping_sub(end));
            (u64::from(y), i64::from(end) + i64::from(gap))
        };
        let length = integer(coder, RUNS + 3 * INTEGER_CONTEXTS, id32(length).wrapping_sub(1));
        let stop = column + i64::from(length) + 1;
        let outside = || error("a run is outside the patch");
        if row >= u64::from(height) || stop > i64::from(width) {
            return Err(outside());
        }
        if cells.len() + length as usize + 1 > count {
            return Err(error(format!("runs of more than {count} points")));
        }
        let number = |x: i64| u32::try_from(x).map_err(|_| outside());
        (y, start, end) = (u32::try_from(row).map_err(|_| outside())?, number(column)?, number(stop)?);
        cells.extend((start..end).map(|x| [x, y]));
        coder.check()?;
    }
    Ok(cells)
}

/// Codes modes and heights of points whose cells are known.
fn code_heights<C: Coder>(
    coder: &mut C,
    lattice: Lattice,
    cells: &[[u32; 2]],
    modes: u32,
    list: Option<&[HeightOverride]>,
) -> Result<Vec<HeightOverride>, DecodeError> {
    let overrides = list.unwrap_or_default();
    let first = overrides.first().map_or(0, |p| p.height);
    let first = coder.raw(32, first.cast_unsigned()).cast_signed();
    // All arithmetic is modulo 2^32, which is lossless for multiples of the step.
    let step = overrides.iter().fold(0, |step, p| gcd(step, p.height.abs_diff(first))).max(1);
    let step = coder.raw(32, step);
    if step == 0 {
        return Err(error("heights have a step of 0"));
    }
    let (wide_first, wide_step) = (i64::from(first), i64::from(step));
    let steps_of = |p: &HeightOverride| low32(((i64::from(p.height) - wide_first) / wide_step).into());
    // In additive lists, points without override have change 0.
    let default_height =
        (modes == 0 && wide_first % wide_step == 0).then(|| low32((-wide_first / wide_step).into()));
    let mut predictor = Predictor::new(lattice.cells[0] as usize, default_height);
    let mut points = Vec::with_capacity(cells.len());
    let mut mode = usize::from(modes == 1);
    for (i, &[column, row]) in cells.iter().enumerate() {
        if modes == 2 {
            let fixed = overrides.get(i).is_some_and(|p| p.mode == Mode::Fixed);
            mode = usize::from(coder.bit(MODES + mode, fixed));
        }
        predictor.advance(row);
        let prediction = predictor.predict(column as usize);
        let at = RESIDUALS + prediction.uncertainty * RESIDUAL_CONTEXTS;
        let residual = overrides.get(i).map_or(0, |p| steps_of(p).wrapping_sub(prediction.value));
        let steps = prediction.value.wrapping_add(unzigzag(code_residual(coder, at, zigzag(residual))));
        predictor.update(column as usize, &prediction, steps);
        // Within the patch, as checked for the lattice.
        let place = |axis: usize, cell: u32| {
            u16::try_from(lattice.first[axis] + cell * lattice.step[axis]).unwrap_or(u16::MAX)
        };
        points.push(HeightOverride {
            x: place(0, column),
            y: place(1, row),
            mode: if mode == 1 { Mode::Fixed } else { Mode::Additive },
            height: first.wrapping_add(steps.wrapping_mul(step.cast_signed())),
        });
    }
    Ok(points)
}

/// Codes 32 bits: the bit count and the two bits below the leading one are adaptive, the rest is raw.
fn code_residual<C: Coder>(coder: &mut C, at: usize, value: u32) -> u32 {
    let class = tree(coder, at, CLASS_BITS, u32::BITS - value.leading_zeros()).min(32);
    if class < 2 {
        return class;
    }
    let mut got = 1_u32;
    let mut below = class - 1;
    for depth in 0..2.min(class - 1) {
        below -= 1;
        let context = at + tree_contexts(CLASS_BITS) + (2 * class.min(32) as usize + depth as usize).min(65);
        got = got << 1 | u32::from(coder.bit(context, value >> below & 1 == 1));
    }
    let rest = coder.raw(below, value & ((1 << below) - 1));
    got << below | rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points(n: u8, list: impl IntoIterator<Item = (u16, u16, i32)>) -> HeightOverrides {
        let point = |(x, y, height)| HeightOverride { x, y, mode: Mode::Additive, height };
        HeightOverrides::new(n, list.into_iter().map(point).collect()).unwrap()
    }

    fn bytes(n: u8, points: &HeightOverrides) -> usize {
        let bytes = encode_points(n, points).unwrap();
        assert_eq!(&decode_points(n, &bytes).unwrap(), points);
        bytes.len()
    }

    proptest! {
        #[test]
        fn lists_survive(
            n in 1u8..13, wild: bool, mixed: bool, stride in 1u16..20, extent in 1u16..400,
            list in prop::collection::hash_map((any::<u16>(), any::<u16>()), (any::<i32>(), any::<bool>()), 0..300),
        ) {
            let side = 1_u16 << n;
            let place = |c: u16| c % extent.min(side + 1) / stride * stride;
            let unique: std::collections::BTreeMap<_, _> =
                list.into_iter().map(|((x, y), of)| ((place(x), place(y)), of)).collect();
            let point = |((x, y), (height, fixed)): (_, (i32, bool))| {
                let mode = if fixed && mixed { Mode::Fixed } else { Mode::Additive };
                HeightOverride { x, y, mode, height: if wild { height } else { height % 100 * 7 } }
            };
            bytes(n, &HeightOverrides::new(n, unique.into_iter().map(point).collect()).unwrap());
        }

        #[test]
        fn any_bytes_give_points_of_the_patch_or_an_error(n in 1u8..13, bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            if let Ok(points) = decode_points(n, &bytes) {
                prop_assert!(points.len() as u64 <= max_elements(bytes.len()));
                prop_assert_eq!(decode_points(n, &encode_points(n, &points).unwrap()).unwrap(), points);
            }
        }
    }

    #[test]
    fn empty_lists_and_single_points_are_small() {
        assert_eq!(bytes(8, &points(8, [])), 0);
        let one = bytes(8, &points(8, [(200, 100, -12_345)]));
        assert!(one <= 20, "{one} bytes");
    }

    #[test]
    fn fully_predicted_lists_are_padded_to_the_allocation_limit() {
        let flat = points(6, (0..65).flat_map(|y| (0..65).map(move |x| (x, y, 5))));
        assert_eq!(bytes(6, &flat), min_bytes(65 * 65));
        // On a lattice, positions cost almost nothing.
        let sparse = points(12, (0..65).flat_map(|y| (0..65).map(move |x| (x * 64, y * 63, 5))));
        assert_eq!(bytes(12, &sparse), min_bytes(65 * 65));
    }

    #[test]
    fn scattered_points_are_runs_and_cost_their_coordinates() {
        let mut random = lodestream_geometry::random::Random::new(1);
        let mut below = |limit| random.below(limit);
        let list: std::collections::BTreeMap<_, _> =
            (0..500).map(|_| ((below(4097) as u16, below(4097) as u16), below(1 << 16) as i32)).collect();
        let size = bytes(12, &points(12, list.into_iter().map(|((x, y), h)| (x, y, h))));
        // Positions of 500 among 4097² points cost at least 16.5 bits each, heights 16.
        assert!(size < 500 * 40 / 8, "{size} bytes");
    }

    #[test]
    fn heights_at_the_limits_survive() {
        let all = [i32::MIN, i32::MAX, 0, -1, 1, i32::MAX, i32::MIN, i32::MIN + 1, i32::MAX - 1];
        bytes(2, &points(2, (0..).zip(all).map(|(i, h)| (i % 5, i / 5, h))));
        bytes(1, &points(1, [(0, 0, i32::MIN), (2, 2, i32::MAX)]));
    }

    #[test]
    fn hostile_headers_are_refused_with_a_reason() {
        let forged = |n: u8, mask: u32, count: u32, lattice: Lattice| {
            let mut encoder = Encoder::new(contexts());
            encoder.raw(1, mask);
            encoder.raw(2, 0);
            integer(&mut encoder, COUNT, count);
            for axis in 0..2 {
                for value in [lattice.first[axis], lattice.cells[axis], lattice.step[axis]] {
                    integer(&mut encoder, LATTICE, value);
                }
            }
            decode_points(n, &encoder.finish(40)).unwrap_err().to_string()
        };
        let whole = Lattice { first: [0, 0], step: [1, 1], cells: [4097, 4097] };
        assert!(forged(12, 0, 5_000_000, whole).contains("5000000 points, its bytes allow 704"));
        assert!(forged(12, 1, 700, whole).contains("a mask of 16785409 places for 700 points"));
        assert!(forged(11, 0, 700, whole).contains("outside the patch"));
        let far = Lattice { step: [0x7fff_ffff, 1], ..whole };
        assert!(forged(12, 0, 700, far).contains("outside the patch"));
        let few = Lattice { cells: [3, 3], ..whole };
        assert!(forged(12, 0, 10, few).contains("10 points in 9 places"));
        assert!(forged(12, 0, 0, few).contains("without points"));
        assert!(decode_points(12, &[0xff; 40]).is_err());
    }
}
