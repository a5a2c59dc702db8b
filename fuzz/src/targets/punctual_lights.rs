//! Punctual lights of a scene: pages of lights, and their directory.

use lodestream_scene::punctual_lights::{
    First, PunctualLight, PunctualLightPageEntry, PunctualLights, decode_directory, decode_page,
    encode_directory, encode_page,
};

use crate::input::Input;
use crate::meter::{Ceiling, within};

/// The first byte selects the format, the second the number of entries: a page of lights, a page of their directory, or
/// a scene's initial lights. Accepted values can be drawn, and survive encoding and decoding up to rounding.
pub fn punctual_lights(data: &[u8]) -> bool {
    let mut input = Input::new(data);
    let (kind, count) = (input.u8(), u32::from(input.u8()));
    let bytes = input.rest();
    within(PUNCTUAL_LIGHTS, bytes.len(), || match kind % 3 {
        0 => decode_page(bytes, count).is_ok_and(|punctual_lights| page(&punctual_lights)),
        1 => decode_directory(bytes, count).is_ok_and(|listed| directory(&listed)),
        _ => match (PunctualLights { count, first: bytes.to_vec() }).first() {
            Ok(First::PunctualLights(punctual_lights)) => page(&punctual_lights),
            Ok(First::Directory(listed)) => directory(&listed),
            Ok(First::Nothing) => true,
            Err(_) => false,
        },
    })
}

/// A light has at least 4 bytes, and 64 in memory; an entry of the directory 21 and 24. Values are encoded and decoded
/// again.
const PUNCTUAL_LIGHTS: Ceiling =
    Ceiling { base_bytes: 1 << 17, bytes_per_byte: 64, base_steps: 0, steps_per_byte: 0 };

fn page(punctual_lights: &[PunctualLight]) -> bool {
    for punctual_light in punctual_lights {
        punctual_light.check().expect("an accepted punctual light can be");
    }
    if punctual_lights.is_empty() {
        return true;
    }
    let bytes = encode_page(punctual_lights).expect("accepted punctual lights are encoded");
    let again =
        decode_page(&bytes, punctual_lights.len() as u32).expect("encoded punctual lights are accepted");
    for (again, punctual_light) in again.iter().zip(punctual_lights) {
        assert_eq!((again.intensity, again.range), (punctual_light.intensity, punctual_light.range));
        assert_eq!(again.spot.is_some(), punctual_light.spot.is_some());
    }
    let entry = PunctualLightPageEntry::of(&again, bytes.len() as u32);
    assert!(encode_directory(&[entry]).is_ok(), "{entry:?}");
    true
}

fn directory(listed: &[PunctualLightPageEntry]) -> bool {
    let bytes = encode_directory(listed).expect("an accepted directory is encoded");
    assert_eq!(decode_directory(&bytes, listed.len() as u32).as_deref(), Ok(listed));
    true
}
