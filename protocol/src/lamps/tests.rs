//! Pages of lamps come back within what is stated; what cannot be is refused.

use std::f32::consts::FRAC_PI_2;

use proptest::prelude::*;

use super::*;

/// The largest angle between two unit vectors that the coding may make, in radians: 0.004°.
const MAX_TURN: f32 = 0.004 * std::f32::consts::PI / 180.0;

fn lamp(position: [f64; 3]) -> Lamp {
    Lamp { position, intensity: [80.0, 60.0, 30.0], range: 12.0, spot: None }
}

fn spot(direction: [f32; 3]) -> Lamp {
    Lamp { spot: Some(Spot { direction, inner: 0.3, outer: 0.7 }), ..lamp([0.0; 3]) }
}

/// A street: alike but for where they stand.
fn street(count: u32) -> Vec<Lamp> {
    (0..count).map(|i| lamp([5.0 * f64::from(i), 6.0, f64::from(i % 2) * 8.0])).collect()
}

fn assert_alike(got: &[Lamp], lamps: &[Lamp]) {
    assert_eq!(got.len(), lamps.len());
    let range = lamps.iter().map(|lamp| lamp.range).fold(f32::MAX, f32::min);
    let extent =
        |axis: usize| lamps.iter().map(move |lamp| (lamp.position[axis] - lamps[0].position[axis]).abs());
    for (got, want) in got.iter().zip(lamps) {
        let rounding = 1e-15 * want.position.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        for axis in 0..3 {
            let widest = (0..3).flat_map(extent).fold(0.0, f64::max);
            let bound = (f64::from(range) / 2048.0).max(widest * 2_f64.powi(-41)) + rounding;
            assert!((got.position[axis] - want.position[axis]).abs() <= bound, "{got:?} {want:?}");
        }
        let brightest = want.brightest();
        for (a, b) in got.intensity.iter().zip(want.intensity) {
            assert!((a - b).abs() <= brightest * (1.01 / 510.0 + 0.002), "{got:?} {want:?}");
        }
        assert!(
            (got.brightest() / brightest - 1.0).abs() <= 0.002
                && (got.range / want.range - 1.0).abs() <= 0.002
        );
        assert_eq!(got.spot.is_some(), want.spot.is_some());
        if let (Some(a), Some(b)) = (got.spot, want.spot) {
            let [a_to, b_to] = [a, b].map(|spot| Vec3::from(spot.direction));
            // The sine, since a cosine near 1 tells nothing apart.
            assert!(a_to.cross(b_to).length() <= MAX_TURN && a_to.dot(b_to) > 0.0, "{a:?} {b:?}");
            assert!((a.inner - b.inner).abs() <= 1e-4 && (a.outer - b.outer).abs() <= 1.1e-4, "{a:?} {b:?}");
        }
    }
}

#[test]
fn a_lamp_takes_14_bytes_a_spot_22_and_the_next_of_a_street_six() {
    let sizes =
        [street(1), vec![spot([0.0, -1.0, 0.0])], street(64)].map(|lamps| encode_page(&lamps).unwrap().len());
    // Version, step, origin and count are 27 bytes. The first lamp is at the origin: a byte for each axis.
    assert_eq!(sizes, [27 + 11, 27 + 19, 27 + 11 + 63 * 6]);
    let apart: Vec<Lamp> =
        (0..64).map(|i| Lamp { range: 12.0 + i as f32, ..street(64)[i as usize] }).collect();
    let bytes = encode_page(
        &apart.iter().map(|lamp| Lamp { intensity: [lamp.range; 3], ..*lamp }).collect::<Vec<_>>(),
    );
    assert!(bytes.unwrap().len() <= 27 + 64 * 14);
}

#[test]
fn pages_come_back_and_every_truncation_is_refused() {
    let mut lamps = street(20);
    lamps.extend([
        spot([0.6, -0.8, 0.0]),
        spot([0.6, -0.8, 0.0]),
        lamp([1e7, 0.25, -3.0]),
        spot([0.0, 0.0, 1.0]),
    ]);
    lamps[3].range = 0.5;
    lamps[4].intensity = [0.0, 0.0, 1e6];
    let bytes = encode_page(&lamps).unwrap();
    let got = decode_page(&bytes, 24).unwrap();
    assert_alike(&got, &lamps);
    // What came back is as exact as it is written again.
    assert_eq!(decode_page(&encode_page(&got).unwrap(), 24).unwrap(), got);
    for end in 0..bytes.len() {
        assert!(decode_page(&bytes[..end], 24).is_err(), "{end}");
    }
    assert_eq!(decode_page(&[&bytes[..], &[0]].concat(), 24), Err(LampsError::TrailingBytes(1)));
    assert_eq!(decode_page(&bytes, 23), Err(LampsError::WrongCount { got: 24, expected: 23 }));
}

#[test]
fn pages_that_cannot_be_are_named() {
    assert!(matches!(encode_page(&[]), Err(LampsError::WrongCount { got: 0, .. })));
    assert!(matches!(encode_page(&street(65)), Err(LampsError::WrongCount { got: 65, .. })));
    let refused = |change: fn(&mut Lamp), why| {
        let mut lamp = spot([0.0, -1.0, 0.0]);
        change(&mut lamp);
        assert_eq!(encode_page(&[lamp]), Err(why), "{lamp:?}");
    };
    refused(|l| l.position[1] = f64::NAN, LampsError::Position);
    refused(|l| l.position[1] = 2e12, LampsError::Position);
    refused(|l| l.intensity = [0.0; 3], LampsError::Intensity);
    refused(|l| l.intensity[0] = -1.0, LampsError::Intensity);
    refused(|l| l.intensity[2] = f32::INFINITY, LampsError::Intensity);
    refused(|l| l.range = 0.0, LampsError::Range);
    refused(|l| l.range = f32::NAN, LampsError::Range);
    refused(|l| l.spot.as_mut().unwrap().direction = [0.0; 3], LampsError::Cone);
    refused(|l| l.spot.as_mut().unwrap().inner = 0.8, LampsError::Cone);
    refused(|l| l.spot.as_mut().unwrap().outer = 2.0, LampsError::Cone);
    // Bytes 0, 1, 26, 27 and 31 to 35: version, exponent, count, flags, colour and brightest.
    let bytes = encode_page(&[spot([0.0, -1.0, 0.0])]).unwrap();
    let with = |at: usize, byte: u8| {
        let mut bytes = bytes.clone();
        bytes[at] = byte;
        decode_page(&bytes, 1)
    };
    assert_eq!(with(0, 9), Err(LampsError::Version(9)));
    assert_eq!(with(26, 65), Err(LampsError::WrongCount { got: 65, expected: 1 }));
    for flags in [16, SAME_AS_NONE, 2, 4, 8] {
        assert!(with(27, flags).is_err(), "{flags}");
    }
    assert_eq!(with(31, 254), Err(LampsError::Intensity), "no component is the brightest");
    assert_eq!(with(35, 0xff), Err(LampsError::Intensity), "not a number");
    assert_eq!(decode_page(&[], 0), Err(LampsError::EndsEarly));
    let far = [&bytes[..28], &[0xff; 9], &[0; 2], &bytes[31..]].concat();
    assert_eq!(decode_page(&far, 1), Err(LampsError::Position));
}

/// A cone like the one before, of a lamp that is the first.
const SAME_AS_NONE: u8 = 1 | 8;

#[test]
fn lengths_that_bytes_cannot_justify_are_refused() {
    assert!(decode_page(&[&[1, 0][..], &[0; 24], &[64]].concat(), 64).is_err());
    for hostile in [&[251, 255, 255][..], &[253, 255, 255, 255, 255, 255, 255, 255, 255]] {
        assert!(decode_directory(hostile, 256).is_err());
    }
}

fn listed(n: u32) -> ListedLamps {
    ListedLamps { center: [n as f32, 0.0, 2.0], radius: 9.0, intensity: 80.0, bytes: 700 }
}

#[test]
fn directories_come_back_and_say_what_their_pages_light() {
    let all: Vec<_> = (0..256).map(listed).collect();
    let bytes = encode_directory(&all).unwrap();
    assert!(bytes.len() <= 3 + 256 * 23);
    assert_eq!(decode_directory(&bytes, 256).unwrap(), all);
    for end in 0..bytes.len() {
        assert!(decode_directory(&bytes[..end], 256).is_err(), "{end}");
    }
    assert!(decode_directory(&bytes, 255).is_err());
    assert!(encode_directory(&(0..257).map(listed).collect::<Vec<_>>()).is_err());
    assert_eq!(encode_directory(&[ListedLamps { radius: f32::NAN, ..listed(0) }]), Err(LampsError::Listed));
    assert_eq!(
        encode_directory(&[ListedLamps { bytes: 5000, ..listed(0) }]),
        Err(LampsError::PageTooLong(5000))
    );
    let lamps: Vec<Lamp> = street(64).into_iter().chain([lamp([1e9 + 0.3, -7.0, 0.0])]).collect();
    let entry = ListedLamps::of(&lamps, 99);
    let center = DVec3::from(entry.center.map(f64::from));
    for lamp in &lamps {
        let reach = DVec3::from(lamp.position).distance(center) + f64::from(lamp.range);
        assert!(reach <= f64::from(entry.radius), "{lamp:?} {entry:?}");
    }
    assert_eq!(entry.intensity, 65.0 * 80.0);
}

#[test]
fn the_message_holds_few_lamps_or_the_directory_of_few_pages() {
    let first = |count, first: Vec<u8>| Lamps { count, first }.first();
    let few = encode_page(&street(16)).unwrap();
    assert!(few.len() <= 400);
    assert!(matches!(first(16, few.clone()), Ok(First::Lamps(lamps)) if lamps.len() == 16));
    let directory = |pages| encode_directory(&(0..pages).map(listed).collect::<Vec<_>>()).unwrap();
    assert!(matches!(first(17, directory(1)), Ok(First::Directory(pages)) if pages.len() == 1));
    assert!(matches!(first(1024, directory(16)), Ok(First::Directory(pages)) if pages.len() == 16));
    assert!(directory(16).len() <= 400);
    assert_eq!(first(1025, Vec::new()), Ok(First::Nothing));
    assert_eq!(first(1025, directory(17)), Err(LampsError::TrailingBytes(directory(17).len())));
    for (count, bytes) in
        [(0, few.clone()), (MAX_LAMPS + 1, Vec::new()), (15, few.clone()), (17, few), (65, directory(1))]
    {
        assert!(first(count, bytes).is_err(), "{count}");
    }
    assert_eq!([64, 65, 1 << 18].map(Lamps::pages_of), [1, 2, 4096]);
    assert_eq!([0, 1, 2].map(|page| Lamps::on_page(65, page)), [64, 1, 0]);
    assert_eq!(Lamps::on_page(65, u32::MAX), 0);
    assert_eq!([64, 16_384, 16_385].map(Lamps::directory_pages_of), [1, 1, 2]);
    assert_eq!([0, 1, 2].map(|page| Lamps::on_directory_page(16_385, page)), [256, 1, 0]);
}

#[test]
fn a_models_lamp_moves_and_turns_with_it_and_keeps_its_range_at_any_scale() {
    let lamp = Lamp { position: [1.0, 2.0, 0.0], ..spot([0.0, 0.0, -1.0]) };
    let turn = DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2);
    let placed = lamp.within(DVec3::new(10.0, 0.0, 0.0), turn, 3.0);
    assert!(DVec3::from(placed.position).distance(DVec3::new(10.0, 6.0, -3.0)) < 1e-12);
    assert!(Vec3::from(placed.spot.unwrap().direction).distance(Vec3::NEG_X) < 1e-6);
    assert_eq!((placed.range, placed.intensity), (lamp.range, lamp.intensity));
    assert_eq!(Lamp::usual_range([4.0, 9.0, 0.0]), 30.0);
}

fn any_lamp() -> impl Strategy<Value = Lamp> {
    let position = prop::array::uniform3(-1e6..1e6_f64);
    let cone = (prop::array::uniform3(-1.0..1.0_f32), 0.0..1.0_f32, 1e-3..FRAC_PI_2);
    let exponent = -3.0..4.0_f32;
    (position, prop::array::uniform3(0.0..1.0_f32), exponent.clone(), exponent, prop::option::of(cone))
        .prop_map(|(position, color, intensity, range, cone)| {
            let brightest = 10_f32.powf(intensity);
            let spot = cone.map(|(direction, share, outer)| Spot {
                direction: Vec3::from(direction).normalize_or(Vec3::X).to_array(),
                inner: share * outer,
                outer,
            });
            let [r, g, _] = color;
            Lamp {
                position,
                intensity: [r * brightest, g * brightest, brightest],
                range: 10_f32.powf(range),
                spot,
            }
        })
}

proptest! {
    #[test]
    fn any_lamps_come_back_within_what_is_stated(lamps in prop::collection::vec(any_lamp(), 1..64)) {
        let bytes = encode_page(&lamps).unwrap();
        prop_assert!(bytes.len() <= MAX_PAGE_BYTES as usize);
        let got = decode_page(&bytes, lamps.len() as u32).unwrap();
        assert_alike(&got, &lamps);
        prop_assert!(got.iter().all(|lamp| lamp.check().is_ok()));
    }

    #[test]
    fn random_bytes_never_panic_and_what_is_accepted_can_be_written(
        bytes in prop::collection::vec(any::<u8>(), 0..400), count in 0..70_u32,
    ) {
        let mut page = bytes.clone();
        if page.len() > 27 {
            (page[0], page[26]) = (1, count as u8);
        }
        if let Ok(lamps) = decode_page(&page, count) && !lamps.is_empty() {
            prop_assert!(encode_page(&lamps).is_ok());
        }
        let _ = decode_directory(&bytes, count);
        let _ = Lamps { count, first: bytes }.first();
    }
}
