//! The attributes of a new wedge: texture coordinates, normal group, colour, explicit normal.

use crate::codec::model::{
    AXIS_LIKE_NEAR, AXIS_UV, BASE_UV, COLOR, EXPLICIT_NORMAL, GROUP, MIX_UV, NORMAL, SAME_COLOR,
    SHARED_PLACES, SHARED_SECOND_UV, SHARED_UV, SIZE_OTHER_CONTEXTS, SIZE_RECENT_CONTEXTS, UV_OTHER,
    UV_RECENT, UV_REST, UV_SIGN,
};
use crate::codec::residual::{Recent, Residual, UNKNOWN};
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::{INTEGER_CONTEXTS, integer, signed};
use crate::error::DecodeError;
use crate::mesh::octahedral;
use crate::mesh::{Attributes, Kinds, NO_COLOR, NORMAL_BITS};

/// Predictions for a new wedge's attributes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Expected {
    pub(crate) uv: [i32; 2],
    /// Expected error sizes of `uv`, in quarter octaves of the uv grid's cells; `None` if unknown.
    pub(crate) uv_size: Option<[i32; 2]>,
    /// Of the second set, as `uv` and `uv_size`.
    pub(crate) second_uv: [i32; 2],
    pub(crate) second_uv_size: Option<[i32; 2]>,
    /// With two sets of texture coordinates, what each may equal: often only one of them has a seam at a vertex.
    pub(crate) shared: [Option<SharedUv>; 2],
    /// If set, whether `uv` equals that of `near` is coded first, with this context.
    pub(crate) like_near: Option<usize>,
    /// If `uv` was projected, the context of its place; `uv_size` is ignored then.
    pub(crate) projected: Option<usize>,
    /// A neighbouring wedge.
    pub(crate) near: Option<Attributes>,
    /// Normal of the faces, of any length.
    pub(crate) normal: [f64; 3],
    /// Whether it is the first wedge of its vertex.
    pub(crate) first: bool,
    /// The group, if it has been coded already.
    pub(crate) known_group: Option<u32>,
    /// The likely group, and the context of whether it is right.
    pub(crate) group: Option<(u32, usize)>,
}

/// A set of texture coordinates of another wedge of a vertex: whether a new wedge's equals it is coded first.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SharedUv {
    pub(crate) uv: [i32; 2],
    /// [`SHARED_ALIKE`] to [`SHARED_IN_BASE`].
    pub(crate) place: usize,
}

/// Places of a new wedge, below [`SHARED_PLACES`]: the vertex of a split, where the old vertex's wedges on both sides
/// have equal coordinates, or not; the corner of a new face; the base mesh.
pub(crate) const SHARED_ALIKE: usize = 0;
pub(crate) const SHARED_UNLIKE: usize = 1;
pub(crate) const SHARED_AT_CORNER: usize = 2;
pub(crate) const SHARED_IN_BASE: usize = 3;

/// Codes whether coordinates equal those of another wedge, if there is one; returns them if so.
pub(crate) fn code_shared<C: Coder>(
    coder: &mut C,
    context: usize,
    shared: Option<SharedUv>,
    want: Option<[i32; 2]>,
) -> Option<[i32; 2]> {
    let SharedUv { uv, place } = shared?;
    coder.bit(context + place, want == Some(uv)).then_some(uv)
}

/// Context of [`code_shared`] for the second set: by whether the first is shared.
pub(crate) fn shared_second(kinds: Kinds, first_shared: Option<SharedUv>, first: [i32; 2]) -> usize {
    let class = match first_shared {
        _ if kinds.uv_bits == 0 => 0,
        Some(shared) if shared.uv == first => 1,
        _ => 2,
    };
    SHARED_SECOND_UV + class * SHARED_PLACES
}

pub(crate) const UV: [Residual; 2] = [axis(0), axis(1)];

const fn axis(axis: usize) -> Residual {
    Residual {
        recent: UV_RECENT + axis * SIZE_RECENT_CONTEXTS,
        other: UV_OTHER + axis * SIZE_OTHER_CONTEXTS,
        sign: UV_SIGN + axis,
        rest: UV_REST,
        mixer: MIX_UV + axis,
    }
}

/// Codes the attributes of a wedge.
pub(crate) fn code_attributes<C: Coder>(
    coder: &mut C,
    kinds: Kinds,
    recent: &mut [Recent; 2],
    expected: &Expected,
    want: Option<Attributes>,
) -> Result<Attributes, DecodeError> {
    let [recent, second_recent] = recent;
    let uv = code_uv(coder, kinds, recent, expected, want)?;
    let second_uv = match kinds.second_uv_bits {
        0 => [0; 2],
        _ => code_second_uv(coder, kinds, second_recent, (expected, uv), want)?,
    };
    let group = code_group(coder, expected, want);
    let color = code_color(coder, kinds, expected, want);
    let normal = code_normal(coder, kinds, expected, want)?;
    Ok(Attributes { uv, group, color, normal, second_uv })
}

fn code_group<C: Coder>(coder: &mut C, expected: &Expected, want: Option<Attributes>) -> u32 {
    if let Some(group) = expected.known_group {
        return group;
    }
    let want = want.map(|w| w.group);
    if let Some((group, context)) = expected.group
        && coder.bit(context, want.is_none_or(|want| want == group))
    {
        return group;
    }
    integer(coder, GROUP + usize::from(expected.first) * INTEGER_CONTEXTS, want.unwrap_or(0))
}

fn code_uv<C: Coder>(
    coder: &mut C,
    kinds: Kinds,
    recent: &mut Recent,
    expected: &Expected,
    want: Option<Attributes>,
) -> Result<[i32; 2], DecodeError> {
    if kinds.uv_bits == 0 {
        return Ok([0; 2]);
    }
    if let Some(uv) = code_shared(coder, SHARED_UV, expected.shared[0], want.map(|w| w.uv)) {
        return Ok(uv);
    }
    if let (Some(context), Some(near)) = (expected.like_near, expected.near)
        && coder.bit(AXIS_LIKE_NEAR + context, want.is_some_and(|w| w.uv == near.uv))
    {
        return Ok(near.uv);
    }
    let Expected { uv, uv_size, projected, .. } = *expected;
    code_residuals(coder, kinds.uv_bits, recent, (uv, uv_size, projected), want.map(|w| w.uv))
}

/// Codes the second set of texture coordinates, as the first without projections.
#[inline(never)]
fn code_second_uv<C: Coder>(
    coder: &mut C,
    kinds: Kinds,
    recent: &mut Recent,
    (expected, first): (&Expected, [i32; 2]),
    want: Option<Attributes>,
) -> Result<[u16; 2], DecodeError> {
    let want = want.map(|w| w.uv_of_set(1));
    let context = shared_second(kinds, expected.shared[0], first);
    let uv = match code_shared(coder, context, expected.shared[1], want) {
        Some(uv) => uv,
        None => {
            let expected = (expected.second_uv, expected.second_uv_size, None);
            code_residuals(coder, kinds.second_uv_bits, recent, expected, want)?
        }
    };
    // In range: below 2^16.
    Ok(uv.map(|x| u16::try_from(x).unwrap_or_default()))
}

/// Codes texture coordinates against their prediction: the value, its expected error sizes, and the context of its
/// place if it was projected.
#[inline(always)]
fn code_residuals<C: Coder>(
    coder: &mut C,
    bits: u8,
    recent: &mut Recent,
    (expected, size, projected): ([i32; 2], Option<[i32; 2]>, Option<usize>),
    want: Option<[i32; 2]>,
) -> Result<[i32; 2], DecodeError> {
    let mut uv = [0; 2];
    let mut other = UNKNOWN;
    // Context by coordinate and by whether the first equalled its projection.
    let mut missed = 0;
    for axis in 0..2 {
        let residual = want.map_or(0, |want| want[axis] - expected[axis]);
        let got = match (projected, size) {
            (Some(place), _) => {
                let got = signed(coder, AXIS_UV + (place * 3 + missed) * INTEGER_CONTEXTS, residual);
                missed = 1 + usize::from(got != 0);
                got
            }
            (None, Some(sizes)) => {
                let size = sizes[axis];
                let got = UV[axis].code(coder, size, recent.class(axis), other, residual);
                other = recent.follow(axis, got, size);
                got
            }
            (None, None) => signed(coder, BASE_UV + axis * INTEGER_CONTEXTS, residual),
        };
        uv[axis] = expected[axis].wrapping_add(got);
        if uv[axis] < 0 || uv[axis] >= 1 << bits {
            return Err(DecodeError::new("wedge", "a texture coordinate is off the grid"));
        }
    }
    Ok(uv)
}

fn code_color<C: Coder>(
    coder: &mut C,
    kinds: Kinds,
    expected: &Expected,
    want: Option<Attributes>,
) -> [u8; 4] {
    let near = expected.near.map_or(NO_COLOR, |n| n.color);
    if !kinds.colors || coder.bit(SAME_COLOR, want.is_none_or(|w| w.color == near)) {
        return near;
    }
    [0, 1, 2, 3].map(|channel| {
        let residual = want.map_or(0, |w| i32::from(w.color[channel]) - i32::from(near[channel]));
        let got = signed(coder, COLOR + channel * INTEGER_CONTEXTS, residual);
        // Modulo 256.
        near[channel].wrapping_add(got.to_le_bytes()[0])
    })
}

/// An explicit normal is predicted from the neighbouring wedge, else from the faces.
fn code_normal<C: Coder>(
    coder: &mut C,
    kinds: Kinds,
    expected: &Expected,
    want: Option<Attributes>,
) -> Result<Option<[u16; 2]>, DecodeError> {
    if !kinds.normals {
        return Ok(None);
    }
    let near = expected.near.map(|n| n.normal);
    let context = near.map_or(2, |n| usize::from(n.is_some()));
    let want = want.and_then(|w| w.normal);
    if !coder.bit(EXPLICIT_NORMAL + context, want.is_some()) {
        return Ok(None);
    }
    let guess = near.flatten().unwrap_or_else(|| octahedral::encode(expected.normal));
    let mut normal = [0_u16; 2];
    for axis in 0..2 {
        let residual = want.map_or(0, |w| i32::from(w[axis]) - i32::from(guess[axis]));
        let got =
            i32::from(guess[axis]).wrapping_add(signed(coder, NORMAL + axis * INTEGER_CONTEXTS, residual));
        normal[axis] = u16::try_from(got)
            .ok()
            .filter(|&n| n < 1 << NORMAL_BITS)
            .ok_or_else(|| DecodeError::new("wedge", "a normal is off its map"))?;
    }
    Ok(Some(normal))
}
