//! Mode ATTRIBUTES: blocks of up to 256 elements. A block stores the first bytes of all elements, then the second bytes
//! and so on, each as the difference from the previous element, in groups of 16 of equal bit width.

use super::error::MeshoptError;
use super::reader::Reader;

/// Most bytes and most elements of a block.
const BLOCK_BYTES: usize = 8192;
const BLOCK: usize = 256;
/// Differences that share a bit width.
const GROUP: usize = 16;
/// Most bytes of a group. The format pads the end by as many, so that decoders may read ahead.
const GROUP_BYTES: usize = 24;
/// Bit widths that a group's header selects in version 0; version 1 selects one of two other tables.
const BITS: [u32; 4] = [0, 2, 4, 8];

/// `stride` is a multiple of 4 up to 256.
pub(super) fn decode(data: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, MeshoptError> {
    let (&head, body) = data.split_first().ok_or(MeshoptError::Truncated)?;
    let version_1 = match head {
        0xa0 => false,
        0xa1 => true,
        _ => return Err(MeshoptError::Header(head)),
    };
    // The tail holds the element before the first and, in version 1, the channel mode of each four bytes.
    let tail = stride + if version_1 { stride / 4 } else { 0 };
    let padded = tail.max(if version_1 { 24 } else { 32 });
    let behind = body.len().checked_sub(tail).ok_or(MeshoptError::Truncated)?;
    let (first, channels) = body[behind..].split_at(stride);
    let mut last = [0; BLOCK];
    last[..stride].copy_from_slice(first);

    let block = (BLOCK_BYTES / stride / GROUP * GROUP).min(BLOCK);
    let (pieces, each) =
        if version_1 { (count.div_ceil(block), stride / 4) } else { (count.div_ceil(4 * GROUP), stride) };
    let least = pieces.saturating_mul(each);
    if body.len().checked_sub(padded).is_none_or(|coded| coded < least) {
        return Err(MeshoptError::Truncated);
    }
    let length = count.checked_mul(stride).ok_or(MeshoptError::Truncated)?;
    let mut elements = vec![0; length];
    let mut reader = Reader::new(body);
    for elements in elements.chunks_mut(block * stride) {
        decode_block(&mut reader, elements, stride, &mut last, version_1.then_some(channels))?;
    }
    if reader.left() == padded { Ok(elements) } else { Err(MeshoptError::TrailingBytes) }
}

/// Decodes one block. `last` is the element before the block, and afterwards the block's last element.
fn decode_block(
    reader: &mut Reader<'_>,
    elements: &mut [u8],
    stride: usize,
    last: &mut [u8; BLOCK],
    channels: Option<&[u8]>,
) -> Result<(), MeshoptError> {
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

/// Four bytes of an element from their coded difference and the previous element's bytes.
fn undo(channel: u8, coded: [u8; 4], before: [u8; 4]) -> Result<[u8; 4], MeshoptError> {
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
        _ => return Err(MeshoptError::Channel),
    })
}

/// Decodes one byte of all elements, in groups.
fn decode_plane(reader: &mut Reader<'_>, plane: &mut [u8], bits: [u32; 4]) -> Result<(), MeshoptError> {
    let headers = reader.take(plane.len().div_ceil(4 * GROUP))?;
    for (index, group) in plane.chunks_exact_mut(GROUP).enumerate() {
        let bits = bits[usize::from(headers[index / 4] >> (2 * (index % 4)) & 3)];
        decode_group(reader, group, bits)?;
    }
    Ok(())
}

/// Decodes sixteen values of 0, 1, 2, 4 or 8 bits. All bits set marks a value that follows the group as a byte.
fn decode_group(reader: &mut Reader<'_>, group: &mut [u8], bits: u32) -> Result<(), MeshoptError> {
    let ahead = reader.ahead::<GROUP_BYTES>()?;
    let mut next = 2 * bits as usize;
    match bits {
        0 => group.fill(0),
        8 => group.copy_from_slice(&ahead[..GROUP]),
        _ => {
            let all = (1 << bits) - 1;
            for (value, at) in group.iter_mut().zip((0..).step_by(bits as usize)) {
                // Single bits are stored from the lowest bit of a byte, wider values from the highest.
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
