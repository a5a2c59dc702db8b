//! The layout byte by byte, and what must be refused.

use std::fmt::Debug;

use proptest::prelude::*;

use super::{CodingError, Decode, Encode, decode, encode};
use crate::description::{SceneHeader, ScenePage};
use crate::terrain::TerrainEntry;
use crate::{BlobId, View};

const PLENTY: usize = 1 << 20;

/// Asserts the bytes of a value, and that no other length of them decodes to it.
fn assert_bytes<T: Encode + Decode + Debug + PartialEq>(value: &T, bytes: &[u8]) {
    assert_eq!(encode(value).as_deref(), Ok(bytes), "{value:?}");
    assert_eq!(decode::<T>(bytes, PLENTY).as_ref(), Ok(value));
    for end in 0..bytes.len() {
        assert_eq!(decode::<T>(&bytes[..end], PLENTY), Err(CodingError::EndsEarly), "{value:?} {end}");
    }
    let longer = [bytes, &[0, 0]].concat();
    assert_eq!(decode::<T>(&longer, PLENTY), Err(CodingError::TrailingBytes { left: 2 }), "{value:?}");
}

#[test]
fn integers_take_as_few_bytes_as_they_need() {
    for (value, bytes) in [
        (0, &[0][..]),
        (250, &[250]),
        (251, &[251, 251, 0]),
        (0xffff, &[251, 255, 255]),
        (0x1_0000, &[252, 0, 0, 1, 0]),
        (0xffff_ffff, &[252, 255, 255, 255, 255]),
        (0x1_0000_0000, &[253, 0, 0, 0, 0, 1, 0, 0, 0]),
        (u64::MAX, &[253, 255, 255, 255, 255, 255, 255, 255, 255]),
    ] {
        assert_bytes(&value, bytes);
        u32::try_from(value).into_iter().for_each(|short| assert_bytes(&short, bytes));
        u16::try_from(value).into_iter().for_each(|short| assert_bytes(&short, bytes));
    }
    for (value, byte) in [(0, 0), (-1, 1), (1, 2), (-2, 3), (125, 250)] {
        assert_bytes::<i32>(&value, &[byte]);
    }
    assert_bytes(&i32::MIN, &[252, 255, 255, 255, 255]);
    assert_bytes(&i32::MAX, &[252, 254, 255, 255, 255]);
}

#[test]
fn integers_in_longer_forms_are_refused() {
    for bytes in [
        &[251, 250, 0][..],
        &[252, 250, 0, 0, 0],
        &[252, 255, 255, 0, 0],
        &[253, 0, 0, 0, 0, 0, 0, 0, 0],
        &[253, 255, 255, 255, 255, 0, 0, 0, 0],
    ] {
        assert_eq!(decode::<u64>(bytes, 0), Err(CodingError::IntegerNotShortest), "{bytes:?}");
        assert_eq!(decode::<u32>(bytes, 0), Err(CodingError::IntegerNotShortest), "{bytes:?}");
        assert_eq!(decode::<u16>(bytes, 0), Err(CodingError::IntegerNotShortest), "{bytes:?}");
        assert_eq!(decode::<i32>(bytes, 0), Err(CodingError::IntegerNotShortest), "{bytes:?}");
    }
}

#[test]
fn integers_beyond_their_type_are_refused() {
    assert_eq!(decode::<u16>(&[252, 0, 0, 1, 0], 0), Err(CodingError::IntegerRange));
    assert_eq!(decode::<u32>(&[253, 0, 0, 0, 0, 1, 0, 0, 0], 0), Err(CodingError::IntegerRange));
    for first in [254, 255] {
        let bytes = [first, 1, 2, 3, 4, 5, 6, 7, 8];
        assert_eq!(decode::<u64>(&bytes, 0), Err(CodingError::IntegerRange));
    }
}

#[test]
fn other_values_are_their_parts_in_order() {
    assert_bytes(&7_u8, &[7]);
    assert_bytes(&255_u8, &[255]);
    assert_bytes(&1.5_f32, &[0, 0, 0xc0, 0x3f]);
    assert_bytes(&-2.0_f64, &[0, 0, 0, 0, 0, 0, 0, 0xc0]);
    assert_bytes(&[1_u8, 2, 255], &[1, 2, 255]);
    assert_bytes(&[1_u32, 300], &[1, 251, 44, 1]);
    assert_bytes(&String::from("é!"), &[3, 0xc3, 0xa9, b'!']);
    assert_bytes(&String::new(), &[0]);
    assert_bytes(&vec![300_u16, 4], &[2, 251, 44, 1, 4]);
    assert_bytes(&Vec::<u16>::new(), &[0]);
    assert_bytes(&vec![String::from("a"), String::new()], &[2, 1, b'a', 0]);
    assert_bytes(&None::<u8>, &[0]);
    assert_bytes(&Some(9_u8), &[1, 9]);
    assert_bytes(&Some(Box::new(9_u8)), &[1, 9]);
    assert_eq!(encode(&(1_u8, 2_u32, "x")).unwrap(), [1, 2, 1, b'x']);
}

#[test]
fn malformed_texts_and_options_are_refused() {
    assert_eq!(decode::<String>(&[2, 0xc3, 0x28], PLENTY), Err(CodingError::Utf8));
    assert_eq!(decode::<Option<u8>>(&[2, 0], PLENTY), Err(CodingError::UnknownVariant("Option")));
}

#[test]
fn a_length_beyond_the_bytes_is_refused_before_anything_is_claimed() {
    for bytes in [
        &[3, 1, 2][..],
        &[251, 255, 255, 1],
        &[252, 255, 255, 255, 255, 1],
        &[253, 255, 255, 255, 255, 255, 255, 255, 255, 1],
    ] {
        // A claim of even one byte would exceed this limit.
        assert_eq!(decode::<String>(bytes, 0), Err(CodingError::EndsEarly), "{bytes:?}");
        assert_eq!(decode::<Vec<u8>>(bytes, 0), Err(CodingError::EndsEarly), "{bytes:?}");
        assert_eq!(decode::<Vec<u64>>(bytes, 0), Err(CodingError::EndsEarly), "{bytes:?}");
        assert_eq!(decode::<Vec<Vec<u8>>>(bytes, 0), Err(CodingError::EndsEarly), "{bytes:?}");
    }
}

#[test]
fn memory_counts_against_one_limit() {
    let numbers = encode(&vec![7_u64; 100]).unwrap();
    assert_eq!(decode::<Vec<u64>>(&numbers, 800).unwrap().len(), 100);
    assert_eq!(decode::<Vec<u64>>(&numbers, 799), Err(CodingError::LimitExceeded));
    let text = encode("four").unwrap();
    assert_eq!(decode::<String>(&text, 4).as_deref(), Ok("four"));
    assert_eq!(decode::<String>(&text, 3), Err(CodingError::LimitExceeded));
    let boxed = encode(&7_u64).unwrap();
    assert!(decode::<Box<u64>>(&boxed, 8).is_ok());
    assert_eq!(decode::<Box<u64>>(&boxed, 7), Err(CodingError::LimitExceeded));
    let nested = encode(&[[1_u8, 2, 3].as_slice(), &[4]].as_slice()).unwrap();
    let needed = 2 * size_of::<Vec<u8>>() + 4;
    assert!(decode::<Vec<Vec<u8>>>(&nested, needed).is_ok());
    assert_eq!(decode::<Vec<Vec<u8>>>(&nested, needed - 1), Err(CodingError::LimitExceeded));
}

proptest! {
    #[test]
    fn values_round_trip(
        numbers in prop::collection::vec(any::<(u16, u32, u64)>(), 0..20),
        signed in prop::collection::vec(any::<i32>(), 0..20),
        bits in any::<[u32; 3]>(),
        text in any::<Option<String>>(),
    ) {
        for (a, b, c) in numbers {
            let shift = a % 64;
            prop_assert_eq!(decode(&encode(&a).unwrap(), 0), Ok(a));
            prop_assert_eq!(decode(&encode(&(b >> (shift % 32))).unwrap(), 0), Ok(b >> (shift % 32)));
            prop_assert_eq!(decode(&encode(&(c >> shift)).unwrap(), 0), Ok(c >> shift));
        }
        prop_assert_eq!(decode(&encode(&signed).unwrap(), PLENTY), Ok(signed));
        prop_assert_eq!(decode(&encode(&text).unwrap(), PLENTY), Ok(text));
        // Compared as bits: floats may be NaN.
        let floats = bits.map(f32::from_bits);
        let back: [f32; 3] = decode(&encode(&floats).unwrap(), 0).unwrap();
        prop_assert_eq!(back.map(f32::to_bits), bits);
    }

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = decode::<SceneHeader>(&bytes, PLENTY);
        let _ = decode::<ScenePage>(&bytes, PLENTY);
        let _ = decode::<TerrainEntry>(&bytes, PLENTY);
        let _ = decode::<View>(&bytes, PLENTY);
        if let Ok(ids) = decode::<Vec<BlobId>>(&bytes, PLENTY) {
            prop_assert_eq!(encode(&ids).unwrap(), bytes);
        }
    }

    /// What decodes has these bytes and no others.
    #[test]
    fn accepted_bytes_are_what_the_value_encodes_to(bytes in prop::collection::vec(any::<u8>(), 0..40)) {
        if let Ok(value) = decode::<u64>(&bytes, 0) {
            prop_assert_eq!(encode(&value).unwrap(), &bytes[..]);
        }
        if let Ok(value) = decode::<Vec<i32>>(&bytes, PLENTY) {
            prop_assert_eq!(encode(&value).unwrap(), &bytes[..]);
        }
        if let Ok(value) = decode::<Vec<Option<String>>>(&bytes, PLENTY) {
            prop_assert_eq!(encode(&value).unwrap(), &bytes[..]);
        }
    }
}
