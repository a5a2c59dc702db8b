//! What a scene says of its lamps: pages of them, and their directory.

use lodestream_protocol::lamps::{
    First, Lamp, Lamps, ListedLamps, decode_directory, decode_page, encode_directory, encode_page,
};

use crate::input::Input;
use crate::meter::{Ceiling, within};

/// The first byte says as what the others are read, the second how many there should be: a page of lamps, a page of their
/// directory, or what is said of that many at once. What is accepted can be, and is nearly the same after it was
/// written and read again.
pub fn lamps(data: &[u8]) -> bool {
    let mut input = Input::new(data);
    let (kind, count) = (input.u8(), u32::from(input.u8()));
    let bytes = input.rest();
    within(LAMPS, bytes.len(), || match kind % 3 {
        0 => decode_page(bytes, count).is_ok_and(|lamps| page(&lamps)),
        1 => decode_directory(bytes, count).is_ok_and(|listed| directory(&listed)),
        _ => match (Lamps { count, first: bytes.to_vec() }).first() {
            Ok(First::Lamps(lamps)) => page(&lamps),
            Ok(First::Directory(listed)) => directory(&listed),
            Ok(First::Nothing) => true,
            Err(_) => false,
        },
    })
}

/// A lamp is 4 bytes at least and 64 in memory; an entry of the directory 21 and 24. What was read is written, and read
/// again.
const LAMPS: Ceiling = Ceiling { base_bytes: 1 << 17, bytes_per_byte: 64, base_steps: 0, steps_per_byte: 0 };

fn page(lamps: &[Lamp]) -> bool {
    for lamp in lamps {
        lamp.check().expect("an accepted lamp can be");
    }
    if lamps.is_empty() {
        return true;
    }
    let bytes = encode_page(lamps).expect("accepted lamps are encoded");
    let again = decode_page(&bytes, lamps.len() as u32).expect("encoded lamps are accepted");
    for (again, lamp) in again.iter().zip(lamps) {
        assert_eq!((again.intensity, again.range), (lamp.intensity, lamp.range));
        assert_eq!(again.spot.is_some(), lamp.spot.is_some());
    }
    let entry = ListedLamps::of(&again, bytes.len() as u32);
    assert!(encode_directory(&[entry]).is_ok(), "{entry:?}");
    true
}

fn directory(listed: &[ListedLamps]) -> bool {
    let bytes = encode_directory(listed).expect("an accepted directory is encoded");
    assert_eq!(decode_directory(&bytes, listed.len() as u32).as_deref(), Ok(listed));
    true
}
