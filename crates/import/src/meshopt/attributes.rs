//! Mode ATTRIBUTES: blocks of up to 256 elements; of each block the first bytes of all elements, then the second ones and
//! so on; each byte as its difference from the element before, in groups of 16 with as many bits as the group needs.

use super::damage::Damage;
use super::reader::Reader;

/// Bytes of a block, and elements, at most.
const BLOCK_BYTES: usize = 8192;
const BLOCK: usize = 256;
/// Differences that share a number of bits.
const GROUP: usize = 16;
/// Bytes that a group may take. The format has that many behind the last one too, so that decoders may read ahead.
const GROUP_BYTES: usize = 24;
/// Bits of a difference, by what a group's header says; version 1 has a choice of two others.
const BITS: [u32; 4] = [0, 2, 4, 8];

/// `stride` is a multiple of 4 up to 256.
pub(super) fn decode(data: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, Damage> {
    let (&head, body) = data.split_first().ok_or(Damage::Short)?;
    let later = match head {
        0xa0 => false,
        0xa1 => true,
        _ => return Err(Damage::Header(head)),
    };
    // At the end stands the element before the first; and in version 1, how each four bytes of an element are coded.
    let tail = stride + if later { stride / 4 } else { 0 };
    let padded = tail.max(if later { 24 } else { 32 });
    let behind = body.len().checked_sub(tail).ok_or(Damage::Short)?;
    let (first, channels) = body[behind..].split_at(stride);
    let mut last = [0; BLOCK];
    last[..stride].copy_from_slice(first);

    let block = (BLOCK_BYTES / stride / GROUP * GROUP).min(BLOCK);
    let (pieces, each) =
        if later { (count.div_ceil(block), stride / 4) } else { (count.div_ceil(4 * GROUP), stride) };
    let least = pieces.saturating_mul(each);
    if body.len().checked_sub(padded).is_none_or(|coded| coded < least) {
        return Err(Damage::Short);
    }
    let length = count.checked_mul(stride).ok_or(Damage::Short)?;
    let mut elements = vec![0; length];
    let mut reader = Reader::new(body);
    for elements in elements.chunks_mut(block * stride) {
        decode_block(&mut reader, elements, stride, &mut last, later.then_some(channels))?;
    }
    if reader.left() == padded { Ok(elements) } else { Err(Damage::Left) }
}

/// One block; `last` is the element before it, and then its last one.
fn decode_block(
    reader: &mut Reader<'_>,
    elements: &mut [u8],
    stride: usize,
    last: &mut [u8; BLOCK],
    channels: Option<&[u8]>,
) -> Result<(), Damage> {
    let count = elements.len() / stride;
    let padded = count.next_multiple_of(GROUP);
    let control = if channels.is_some() { reader.take(stride / 4)? } else { &[] };
    let mut planes = [[0; BLOCK]; 4];
    for lane in 0..stride / 4 {
        for (number, plane) in planes.iter_mut().enumerate() {
            match control.get(lane).map(|control| control >> (2 * number) & 3) {
                None => decode_plane(reader, &mut plane[..padded], BITS)?,
                Some(0) => decode_plane(reader, &mut plane[..padded], [0, 1, 2, 4])?,
                Some(1) => decode_plane(reader, &mut plane[..padded], [1, 2, 4, 8])?,
                Some(2) => plane[..count].fill(0),
                Some(_) => plane[..count].copy_from_slice(reader.take(count)?),
            }
        }
        let channel = channels.map_or(0, |channels| channels[lane]);
        let mut before = [0; 4];
        before.copy_from_slice(&last[4 * lane..4 * lane + 4]);
        for (index, element) in elements.chunks_exact_mut(stride).enumerate() {
            before = undo(channel, planes.each_ref().map(|plane| plane[index]), before)?;
            element[4 * lane..4 * lane + 4].copy_from_slice(&before);
        }
        last[4 * lane..4 * lane + 4].copy_from_slice(&before);
    }
    Ok(())
}

/// Four bytes of an element, of what differs and of those of the element before.
fn undo(channel: u8, coded: [u8; 4], before: [u8; 4]) -> Result<[u8; 4], Damage> {
    let pairs = |bytes: [u8; 4]| [[bytes[0], bytes[1]], [bytes[2], bytes[3]]].map(u16::from_le_bytes);
    Ok(match channel & 3 {
        0 => std::array::from_fn(|i| {
            let difference = (coded[i] >> 1) ^ (coded[i] & 1).wrapping_neg();
            before[i].wrapping_add(difference)
        }),
        1 => {
            let (coded, before) = (pairs(coded), pairs(before));
            let [low, high] = [0, 1].map(|i| {
                let difference = (coded[i] >> 1) ^ (coded[i] & 1).wrapping_neg();
                before[i].wrapping_add(difference).to_le_bytes()
            });
            [low[0], low[1], high[0], high[1]]
        }
        2 => {
            let turned = u32::from_le_bytes(coded).rotate_right(u32::from(channel >> 4));
            (turned ^ u32::from_le_bytes(before)).to_le_bytes()
        }
        _ => return Err(Damage::Channel),
    })
}

/// The bytes of one place in all elements, in groups.
fn decode_plane(reader: &mut Reader<'_>, plane: &mut [u8], bits: [u32; 4]) -> Result<(), Damage> {
    let headers = reader.take(plane.len().div_ceil(4 * GROUP))?;
    for (index, group) in plane.chunks_exact_mut(GROUP).enumerate() {
        let bits = bits[usize::from(headers[index / 4] >> (2 * (index % 4)) & 3)];
        decode_group(reader, group, bits)?;
    }
    Ok(())
}

/// Sixteen values of 0, 1, 2, 4 or 8 bits. One whose bits are all set stands behind them as a byte.
fn decode_group(reader: &mut Reader<'_>, group: &mut [u8], bits: u32) -> Result<(), Damage> {
    let ahead = reader.ahead::<GROUP_BYTES>()?;
    let mut next = 2 * bits as usize;
    match bits {
        0 => group.fill(0),
        8 => group.copy_from_slice(&ahead[..GROUP]),
        _ => {
            let all = (1 << bits) - 1;
            for (value, at) in group.iter_mut().zip((0..).step_by(bits as usize)) {
                // Single bits begin at the lowest of their byte, wider ones at the highest.
                let shift = if bits == 1 { at % 8 } else { 8 - bits - at % 8 };
                *value = ahead[at as usize / 8] >> shift & all;
                if *value == all {
                    *value = ahead[next];
                    next += 1;
                }
            }
        }
    }
    reader.take(next).map(|_| ())
}
