//! Pages of punctual lights: round trips within the stated precision, and invalid pages.

use std::f32::consts::FRAC_PI_2;

use proptest::prelude::*;

use super::*;

/// The largest angle between two unit vectors that the coding may make, in radians: 0.004°.
const MAX_TURN: f32 = 0.004 * std::f32::consts::PI / 180.0;

fn punctual_light(position: [f64; 3]) -> PunctualLight {
    PunctualLight { position, intensity: [80.0, 60.0, 30.0], range: 12.0, spot: None }
}

fn spot(direction: [f32; 3]) -> PunctualLight {
    PunctualLight { spot: Some(Spot { direction, inner: 0.3, outer: 0.7 }), ..punctual_light([0.0; 3]) }
}

/// A street: lights that differ in position only.
fn street(count: u32) -> Vec<PunctualLight> {
    (0..count).map(|i| punctual_light([5.0 * f64::from(i), 6.0, f64::from(i % 2) * 8.0])).collect()
}

fn assert_alike(got: &[PunctualLight], punctual_lights: &[PunctualLight]) {
    assert_eq!(got.len(), punctual_lights.len());
    let range = punctual_lights.iter().map(|punctual_light| punctual_light.range).fold(f32::MAX, f32::min);
    let extent = |axis: usize| {
        punctual_lights.iter().map(move |punctual_light| {
            (punctual_light.position[axis] - punctual_lights[0].position[axis]).abs()
        })
    };
    for (got, want) in got.iter().zip(punctual_lights) {
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
            // The sine, since a cosine near 1 is not precise enough.
            assert!(a_to.cross(b_to).length() <= MAX_TURN && a_to.dot(b_to) > 0.0, "{a:?} {b:?}");
            assert!((a.inner - b.inner).abs() <= 1e-4 && (a.outer - b.outer).abs() <= 1.1e-4, "{a:?} {b:?}");
        }
    }
}

#[test]
fn lights_take_14_bytes_spots_22_and_similar_ones_6() {
    let sizes = [street(1), vec![spot([0.0, -1.0, 0.0])], street(64)]
        .map(|punctual_lights| encode_page(&punctual_lights).unwrap().len());
    // Version, step, origin and count are 27 bytes. The first punctual light is at the origin: a byte for each axis.
    assert_eq!(sizes, [27 + 11, 27 + 19, 27 + 11 + 63 * 6]);
    let apart: Vec<PunctualLight> =
        (0..64).map(|i| PunctualLight { range: 12.0 + i as f32, ..street(64)[i as usize] }).collect();
    let bytes = encode_page(
        &apart
            .iter()
            .map(|punctual_light| PunctualLight { intensity: [punctual_light.range; 3], ..*punctual_light })
            .collect::<Vec<_>>(),
    );
    assert!(bytes.unwrap().len() <= 27 + 64 * 14);
}

#[test]
fn pages_round_trip_and_every_truncation_is_refused() {
    let mut punctual_lights = street(20);
    punctual_lights.extend([
        spot([0.6, -0.8, 0.0]),
        spot([0.6, -0.8, 0.0]),
        punctual_light([1e7, 0.25, -3.0]),
        spot([0.0, 0.0, 1.0]),
    ]);
    punctual_lights[3].range = 0.5;
    punctual_lights[4].intensity = [0.0, 0.0, 1e6];
    let bytes = encode_page(&punctual_lights).unwrap();
    let got = decode_page(&bytes, 24).unwrap();
    assert_alike(&got, &punctual_lights);
    // Decoded lights are encoded again without loss.
    assert_eq!(decode_page(&encode_page(&got).unwrap(), 24).unwrap(), got);
    for end in 0..bytes.len() {
        assert!(decode_page(&bytes[..end], 24).is_err(), "{end}");
    }
    assert_eq!(decode_page(&[&bytes[..], &[0]].concat(), 24), Err(PunctualLightsError::TrailingBytes(1)));
    assert_eq!(decode_page(&bytes, 23), Err(PunctualLightsError::WrongCount { got: 24, expected: 23 }));
}

#[test]
fn invalid_light_pages_have_distinct_errors() {
    assert!(matches!(encode_page(&[]), Err(PunctualLightsError::WrongCount { got: 0, .. })));
    assert!(matches!(encode_page(&street(65)), Err(PunctualLightsError::WrongCount { got: 65, .. })));
    let refused = |change: fn(&mut PunctualLight), why| {
        let mut punctual_light = spot([0.0, -1.0, 0.0]);
        change(&mut punctual_light);
        assert_eq!(encode_page(&[punctual_light]), Err(why), "{punctual_light:?}");
    };
    refused(|l| l.position[1] = f64::NAN, PunctualLightsError::Position);
    refused(|l| l.position[1] = 2e12, PunctualLightsError::Position);
    refused(|l| l.intensity = [0.0; 3], PunctualLightsError::Intensity);
    refused(|l| l.intensity[0] = -1.0, PunctualLightsError::Intensity);
    refused(|l| l.intensity[2] = f32::INFINITY, PunctualLightsError::Intensity);
    refused(|l| l.range = 0.0, PunctualLightsError::Range);
    refused(|l| l.range = f32::NAN, PunctualLightsError::Range);
    refused(|l| l.spot.as_mut().unwrap().direction = [0.0; 3], PunctualLightsError::Cone);
    refused(|l| l.spot.as_mut().unwrap().inner = 0.8, PunctualLightsError::Cone);
    refused(|l| l.spot.as_mut().unwrap().outer = 2.0, PunctualLightsError::Cone);
    // Bytes 0, 1, 26, 27 and 31 to 35: version, exponent, count, flags, colour and brightest.
    let bytes = encode_page(&[spot([0.0, -1.0, 0.0])]).unwrap();
    let with = |at: usize, byte: u8| {
        let mut bytes = bytes.clone();
        bytes[at] = byte;
        decode_page(&bytes, 1)
    };
    assert_eq!(with(0, 9), Err(PunctualLightsError::Version(9)));
    assert_eq!(with(26, 65), Err(PunctualLightsError::WrongCount { got: 65, expected: 1 }));
    for flags in [16, SAME_AS_NONE, 2, 4, 8] {
        assert!(with(27, flags).is_err(), "{flags}");
    }
    assert_eq!(with(31, 254), Err(PunctualLightsError::Intensity), "no component is the brightest");
    assert_eq!(with(35, 0xff), Err(PunctualLightsError::Intensity), "not a number");
    assert_eq!(decode_page(&[], 0), Err(PunctualLightsError::EndsEarly));
    let far = [&bytes[..28], &[0xff; 9], &[0; 2], &bytes[31..]].concat();
    assert_eq!(decode_page(&far, 1), Err(PunctualLightsError::Position));
}

/// First light of a page whose flags refer to the cone of the light before it.
const SAME_AS_NONE: u8 = 1 | 8;

#[test]
fn lengths_that_bytes_cannot_justify_are_refused() {
    assert!(decode_page(&[&[1, 0][..], &[0; 24], &[64]].concat(), 64).is_err());
    for hostile in [&[251, 255, 255][..], &[253, 255, 255, 255, 255, 255, 255, 255, 255]] {
        assert!(decode_directory(hostile, 256).is_err());
    }
}

fn listed(n: u32) -> PunctualLightPageEntry {
    PunctualLightPageEntry { center: [n as f32, 0.0, 2.0], radius: 9.0, intensity: 80.0, bytes: 700 }
}

#[test]
fn directories_round_trip_and_bound_their_pages() {
    let all: Vec<_> = (0..256).map(listed).collect();
    let bytes = encode_directory(&all).unwrap();
    assert!(bytes.len() <= 3 + 256 * 23);
    assert_eq!(decode_directory(&bytes, 256).unwrap(), all);
    for end in 0..bytes.len() {
        assert!(decode_directory(&bytes[..end], 256).is_err(), "{end}");
    }
    assert!(decode_directory(&bytes, 255).is_err());
    assert!(encode_directory(&(0..257).map(listed).collect::<Vec<_>>()).is_err());
    assert_eq!(
        encode_directory(&[PunctualLightPageEntry { radius: f32::NAN, ..listed(0) }]),
        Err(PunctualLightsError::Listed)
    );
    assert_eq!(
        encode_directory(&[PunctualLightPageEntry { bytes: 5000, ..listed(0) }]),
        Err(PunctualLightsError::PageTooLong(5000))
    );
    let punctual_lights: Vec<PunctualLight> =
        street(64).into_iter().chain([punctual_light([1e9 + 0.3, -7.0, 0.0])]).collect();
    let entry = PunctualLightPageEntry::of(&punctual_lights, 99);
    let center = DVec3::from(entry.center.map(f64::from));
    for punctual_light in &punctual_lights {
        let reach = DVec3::from(punctual_light.position).distance(center) + f64::from(punctual_light.range);
        assert!(reach <= f64::from(entry.radius), "{punctual_light:?} {entry:?}");
    }
    assert_eq!(entry.intensity, 65.0 * 80.0);
}

#[test]
fn the_message_holds_few_punctual_lights_or_the_directory_of_few_pages() {
    let first = |count, first: Vec<u8>| PunctualLights { count, first }.first();
    let few = encode_page(&street(16)).unwrap();
    assert!(few.len() <= 400);
    assert!(
        matches!(first(16, few.clone()), Ok(First::PunctualLights(punctual_lights)) if punctual_lights.len() == 16)
    );
    let directory = |pages| encode_directory(&(0..pages).map(listed).collect::<Vec<_>>()).unwrap();
    assert!(matches!(first(17, directory(1)), Ok(First::Directory(pages)) if pages.len() == 1));
    assert!(matches!(first(1024, directory(16)), Ok(First::Directory(pages)) if pages.len() == 16));
    assert!(directory(16).len() <= 400);
    assert_eq!(first(1025, Vec::new()), Ok(First::Nothing));
    assert_eq!(first(1025, directory(17)), Err(PunctualLightsError::TrailingBytes(directory(17).len())));
    for (count, bytes) in [
        (0, few.clone()),
        (MAX_PUNCTUAL_LIGHTS + 1, Vec::new()),
        (15, few.clone()),
        (17, few),
        (65, directory(1)),
    ] {
        assert!(first(count, bytes).is_err(), "{count}");
    }
    assert_eq!([64, 65, 1 << 18].map(PunctualLights::pages_of), [1, 2, 4096]);
    assert_eq!([0, 1, 2].map(|page| PunctualLights::on_page(65, page)), [64, 1, 0]);
    assert_eq!(PunctualLights::on_page(65, u32::MAX), 0);
    assert_eq!([64, 16_384, 16_385].map(PunctualLights::directory_pages_of), [1, 1, 2]);
    assert_eq!([0, 1, 2].map(|page| PunctualLights::on_directory_page(16_385, page)), [256, 1, 0]);
}

#[test]
fn model_lights_are_transformed_without_scaling_their_range() {
    let punctual_light = PunctualLight { position: [1.0, 2.0, 0.0], ..spot([0.0, 0.0, -1.0]) };
    let turn = glam::DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2);
    let placed = punctual_light.within(&Placement::new(DVec3::new(10.0, 0.0, 0.0), turn, 3.0));
    assert!(DVec3::from(placed.position).distance(DVec3::new(10.0, 6.0, -3.0)) < 1e-6);
    assert!(Vec3::from(placed.spot.unwrap().direction).distance(Vec3::NEG_X) < 1e-6);
    assert_eq!((placed.range, placed.intensity), (punctual_light.range, punctual_light.intensity));
    assert_eq!(PunctualLight::usual_range([4.0, 9.0, 0.0]), 30.0);
}

fn any_punctual_light() -> impl Strategy<Value = PunctualLight> {
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
            PunctualLight {
                position,
                intensity: [r * brightest, g * brightest, brightest],
                range: 10_f32.powf(range),
                spot,
            }
        })
}

proptest! {
    #[test]
    fn random_lights_round_trip_within_the_stated_precision(punctual_lights in prop::collection::vec(any_punctual_light(), 1..64)) {
        let bytes = encode_page(&punctual_lights).unwrap();
        prop_assert!(bytes.len() <= MAX_PAGE_BYTES as usize);
        let got = decode_page(&bytes, punctual_lights.len() as u32).unwrap();
        assert_alike(&got, &punctual_lights);
        prop_assert!(got.iter().all(|punctual_light| punctual_light.check().is_ok()));
    }

    #[test]
    fn random_bytes_never_panic_and_accepted_pages_can_be_encoded(
        bytes in prop::collection::vec(any::<u8>(), 0..400), count in 0..70_u32,
    ) {
        let mut page = bytes.clone();
        if page.len() > 27 {
            (page[0], page[26]) = (1, count as u8);
        }
        if let Ok(punctual_lights) = decode_page(&page, count) && !punctual_lights.is_empty() {
            prop_assert!(encode_page(&punctual_lights).is_ok());
        }
        let _ = decode_directory(&bytes, count);
        let _ = PunctualLights { count, first: bytes }.first();
    }
}
