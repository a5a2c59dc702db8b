//! Descriptions of a terrain: parameters, stamps, height overrides of a patch.

use lodestream_terrain::{
    HeightOverrides, PARAMETERS_BYTES, Parameters, Scratch, Stamp, Terrain, decode_points, decode_stamps,
    encode_points, encode_stamps,
};

use crate::input::Input;
use crate::meter::{Ceiling, within};

/// The first byte selects the format: parameters, stamps, or height overrides of a patch at the level that the second
/// byte gives. Accepted values are equal after encoding and decoding, and heights can be generated with them.
pub fn terrain(data: &[u8]) -> bool {
    let mut input = Input::new(data);
    let kind = input.u8();
    match kind % 3 {
        0 => parameters(input.rest()),
        1 => stamps(input.rest()),
        _ => {
            let finest_level = 1 + input.u8() % 12;
            points(finest_level, input.rest())
        }
    }
}

/// A stamp has at least 6 bytes, and 56 in memory, with up to 16 positions of 16 bytes for 2 each.
const STAMPS: Ceiling = Ceiling { base_bytes: 1 << 12, bytes_per_byte: 64, base_steps: 0, steps_per_byte: 0 };

/// A byte encodes at most 16 overrides, and each occupies at most 64 places of a mask; rows of the widest patch and the
/// model take a megabyte.
const POINTS: Ceiling =
    Ceiling { base_bytes: 1 << 21, bytes_per_byte: 16 * 64, base_steps: 1 << 14, steps_per_byte: 16 * 80 };

fn parameters(bytes: &[u8]) -> bool {
    let Some(bytes) = bytes.first_chunk::<PARAMETERS_BYTES>() else { return false };
    let Ok(parameters) = Parameters::decode(bytes) else { return false };
    assert_eq!(&parameters.encode(), bytes);
    // The eroded level may need a margin of 256 points, which is valid but slow.
    if parameters.erosion.passes <= 16 {
        heights(&Terrain::new(parameters).expect("accepted parameters make a terrain"));
    }
    true
}

fn stamps(bytes: &[u8]) -> bool {
    let Ok(stamps) = within(STAMPS, bytes.len(), || decode_stamps(bytes)) else { return false };
    let again = encode_stamps(&stamps).expect("accepted stamps are encoded");
    assert_eq!(decode_stamps(&again).as_deref(), Ok(&stamps[..]));
    heights(&with_stamps(12, stamps));
    true
}

fn points(finest_level: u8, bytes: &[u8]) -> bool {
    let read = || decode_points(finest_level, bytes);
    let Ok(points) = within(POINTS, bytes.len(), read) else { return false };
    let again = encode_points(finest_level, &points).expect("accepted points are encoded");
    assert_eq!(decode_points(finest_level, &again).as_ref(), Ok(&points));
    apply(finest_level, points);
    true
}

fn apply(finest_level: u8, points: HeightOverrides) {
    let mut terrain = with_stamps(finest_level, Vec::new());
    terrain.set_points(0, -1, points).expect("accepted points are listed");
    heights(&terrain);
}

fn with_stamps(finest_level: u8, stamps: Vec<Stamp>) -> Terrain {
    let parameters = Parameters { finest_level, extent_log2: 10, ..Parameters::default() };
    Terrain::with_stamps(parameters, stamps).expect("accepted stamps are taken")
}

/// Generates a few heights.
fn heights(terrain: &Terrain) {
    let (mut scratch, mut out) = (Scratch::new(), Vec::new());
    let edge = terrain.edge(0).expect("there is a level 0");
    for level in [0, 3.min(terrain.finest_level() as u8)] {
        terrain.patch_into(0, -1, level, &mut scratch, &mut out).expect("the patch is in the world");
        terrain.patch_into(edge - 1, -edge, level, &mut scratch, &mut out).expect("the corner is, too");
    }
}
