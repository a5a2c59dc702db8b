//! Decoding against the codecs of the library meshoptimizer, and of invalid data.

use meshopt::EncodeExpMode;

use super::{Filter, MeshoptError, Mode, decode};

const PLAIN: Mode = Mode::Attributes(None);

/// Seeded numbers (Steele, Lea and Flood, SplitMix64, 2014).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(crate) fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }

    /// A number in `-1..=1`.
    fn share(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 23) as f32 - 1.0
    }
}

/// Elements of all kinds that the codec distinguishes: constant bytes, slopes, floats, noise.
fn elements<const N: usize>(count: usize) -> Vec<[u8; N]> {
    let mut random = Random(N as u64);
    let element = |index: usize| {
        std::array::from_fn(|byte| match byte / 4 % 4 {
            0 => (index as f32 * 0.37).sin().to_le_bytes()[byte % 4],
            1 => (index as u32 * 3).to_le_bytes()[byte % 4],
            2 => random.next() as u8 >> (byte % 4 * 2),
            _ => 7,
        })
    };
    (0..count).map(element).collect()
}

/// Triangles of a grid of `n` by `n` cells.
fn grid(n: u32) -> Vec<u32> {
    let cell = |at: u32| {
        let (a, row) = (at / n * (n + 1) + at % n, n + 1);
        [a, a + 1, a + row, a + row, a + 1, a + row + 1]
    };
    (0..n * n).flat_map(cell).collect()
}

/// Lists of triangles: adjacent, distant, repeated, rotated.
fn lists() -> Vec<Vec<u32>> {
    let mut random = Random(5);
    let noise = (0..999).map(|_| random.below(70_000) as u32).collect();
    let fan = (1..200).flat_map(|i| [0, i, i + 1]).collect();
    let falling = (0..300).rev().flat_map(|i| [i + 2, i, i + 1]).collect();
    vec![Vec::new(), vec![0, 1, 2], grid(1), grid(17), noise, fan, falling, vec![9; 30]]
}

fn bytes(indices: &[u32]) -> Vec<u8> {
    indices.iter().flat_map(|i| i.to_le_bytes()).collect()
}

fn attributes_come_back<const N: usize>() {
    for count in [1, 2, 15, 16, 17, 63, 64, 65, 255, 256, 257, 1000] {
        let elements = elements::<N>(count);
        for (version, level) in [(0, 0), (1, 0), (1, 1), (1, 2), (1, 3)] {
            let data = meshopt::encode_vertex_buffer_level(&elements, level, Some(version)).unwrap();
            assert_eq!(data[0], 0xa0 + version as u8);
            let decoded = decode(PLAIN, &data, count, N).unwrap();
            assert!(decoded == elements.as_flattened(), "{count} of {N}, version {version}, level {level}");
        }
    }
}

#[test]
fn attributes_of_every_length_and_version_come_back() {
    attributes_come_back::<4>();
    attributes_come_back::<8>();
    attributes_come_back::<12>();
    attributes_come_back::<20>();
    attributes_come_back::<32>();
    attributes_come_back::<48>();
    attributes_come_back::<128>();
    attributes_come_back::<256>();
}

#[test]
fn triangles_and_indices_come_back_in_both_widths() {
    for list in lists() {
        let most = list.iter().max().map_or(0, |&most| most as usize + 1);
        let triangles = meshopt::encode_index_buffer(&list, most).unwrap();
        let sequence = meshopt::encode_index_sequence(&list, most).unwrap();
        for (mode, data) in [(Mode::Triangles, &triangles), (Mode::Indices, &sequence)] {
            let wide = decode(mode, data, list.len(), 4).unwrap();
            // The encoder may rotate a triangle to begin with another corner.
            if mode == Mode::Indices {
                assert_eq!(wide, bytes(&list));
            } else {
                assert_eq!(wide, bytes(&meshopt::decode_index_buffer::<u32>(data, list.len()).unwrap()));
            }
            let narrow = decode(mode, data, list.len(), 2).unwrap();
            assert!(narrow.chunks_exact(2).eq(wide.chunks_exact(4).map(|index| &index[..2])));
        }
    }
}

/// Whether corresponding numbers differ by at most one.
fn near(ours: impl Iterator<Item = i32>, theirs: impl Iterator<Item = i32>) -> bool {
    ours.zip(theirs).all(|(a, b)| (a - b).abs() <= 1)
}

#[test]
fn filters_are_undone_as_the_library_does_but_for_its_estimated_roots() {
    let mut random = Random(3);
    let unit = |random: &mut Random, n: usize| {
        let v: [f32; 4] = std::array::from_fn(|i| if i < n { random.share() } else { 0.0 });
        v.map(|x| x / v.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-3))
    };
    let normals: Vec<[f32; 4]> = (0..1000).map(|_| unit(&mut random, 3)).collect();
    let turns: Vec<[f32; 4]> = (0..1000).map(|_| unit(&mut random, 4)).collect();
    let colors: Vec<[f32; 4]> = (0..1000).map(|_| std::array::from_fn(|_| random.share().abs())).collect();
    let widen = |bytes: &[u8]| -> Vec<i32> {
        bytes.chunks_exact(2).map(|v| i32::from(i16::from_le_bytes([v[0], v[1]]))).collect()
    };

    let mut theirs = meshopt::encode_filter_oct::<i8>(&normals, 8);
    let data = meshopt::encode_vertex_buffer(&theirs).unwrap();
    meshopt::decode_filter_oct(&mut theirs);
    let ours = decode(Mode::Attributes(Some(Filter::Octahedral)), &data, 1000, 4).unwrap();
    let theirs = theirs.as_flattened().iter().map(|&v| i32::from(v));
    assert!(near(ours.iter().map(|&v| i32::from(v as i8)), theirs));
    for (normal, ours) in normals.iter().zip(ours.chunks_exact(4)) {
        let dot: f32 = (0..3).map(|i| normal[i] * f32::from(ours[i] as i8) / 127.0).sum();
        assert!(dot > 0.99, "{normal:?} {ours:?}");
    }

    let mut theirs = meshopt::encode_filter_oct::<i16>(&normals, 12);
    let data = meshopt::encode_vertex_buffer(&theirs).unwrap();
    meshopt::decode_filter_oct(&mut theirs);
    let ours = decode(Mode::Attributes(Some(Filter::Octahedral)), &data, 1000, 8).unwrap();
    assert!(near(widen(&ours).into_iter(), theirs.as_flattened().iter().map(|&v| i32::from(v))));

    let mut theirs = meshopt::encode_filter_quat(&turns, 16);
    let data = meshopt::encode_vertex_buffer(&theirs).unwrap();
    meshopt::decode_filter_quat(&mut theirs);
    let ours = decode(Mode::Attributes(Some(Filter::Quaternion)), &data, 1000, 8).unwrap();
    assert!(near(widen(&ours).into_iter(), theirs.as_flattened().iter().map(|&v| i32::from(v))));

    let floats: Vec<[f32; 3]> =
        (0..1000).map(|i| std::array::from_fn(|_| random.share() * i as f32)).collect();
    let mut theirs = meshopt::encode_filter_exp(&floats, 15, EncodeExpMode::SharedVector);
    let data = meshopt::encode_vertex_buffer(&theirs).unwrap();
    meshopt::decode_filter_exp(&mut theirs);
    let ours = decode(Mode::Attributes(Some(Filter::Exponential)), &data, 1000, 12).unwrap();
    assert_eq!(ours, bytes(theirs.as_flattened()), "no root is taken here");

    let mut theirs = meshopt::encode_filter_color::<u8>(&colors, 8);
    let data = meshopt::encode_vertex_buffer(&theirs).unwrap();
    meshopt::decode_filter_color(&mut theirs);
    let ours = decode(Mode::Attributes(Some(Filter::Color)), &data, 1000, 4).unwrap();
    let theirs = theirs.as_flattened().iter().map(|&v| i32::from(v));
    assert!(near(ours.iter().map(|&v| i32::from(v)), theirs));
    let mut theirs = meshopt::encode_filter_color::<u16>(&colors, 16);
    let data = meshopt::encode_vertex_buffer(&theirs).unwrap();
    meshopt::decode_filter_color(&mut theirs);
    let ours = decode(Mode::Attributes(Some(Filter::Color)), &data, 1000, 8).unwrap();
    let theirs = theirs.as_flattened().iter().map(|&v| i32::from(v));
    assert!(near(widen(&ours).into_iter().map(|v| v & 0xffff), theirs));
}

/// Octahedral and quaternion filters take square roots; the result must not depend on the machine.
#[test]
fn undone_filters_are_the_same_on_every_machine() {
    let mut random = Random(11);
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for (filter, stride) in [
        (Filter::Octahedral, 4),
        (Filter::Octahedral, 8),
        (Filter::Quaternion, 8),
        (Filter::Exponential, 12),
        (Filter::Color, 4),
        (Filter::Color, 8),
    ] {
        let mut elements: Vec<u8> = (0..stride * 500).map(|_| random.next() as u8).collect();
        filter.undo(&mut elements, stride);
        for byte in elements {
            // Fowler, Noll and Vo's hash, 1a.
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
        }
    }
    assert_eq!(hash, 0xc49e_082d_bd87_cd4d, "{hash:#x}");
}

/// Streams of every mode, with the decoder of the library.
type Theirs = fn(&[u8], usize) -> Option<Vec<u8>>;

fn streams() -> Vec<(Mode, Vec<u8>, usize, usize, Theirs)> {
    let mut streams: Vec<(Mode, Vec<u8>, usize, usize, Theirs)> = Vec::new();
    for version in [0, 1] {
        let data = meshopt::encode_vertex_buffer_level(&elements::<16>(70), 3, Some(version)).unwrap();
        let theirs: Theirs = |data, count| {
            Some(meshopt::decode_vertex_buffer::<[u8; 16]>(data, count).ok()?.as_flattened().to_vec())
        };
        streams.push((PLAIN, data, 70, 16, theirs));
    }
    for list in [grid(6), lists()[4][..60].to_vec()] {
        let data = meshopt::encode_index_buffer(&list, 70_000).unwrap();
        let theirs: Theirs =
            |data, count| meshopt::decode_index_buffer::<u32>(data, count).ok().map(|list| bytes(&list));
        streams.push((Mode::Triangles, data, list.len(), 4, theirs));
        let data = meshopt::encode_index_sequence(&list, 70_000).unwrap();
        let theirs: Theirs =
            |data, count| meshopt::decode_index_sequence::<u32>(data, count).ok().map(|list| bytes(&list));
        streams.push((Mode::Indices, data, list.len(), 4, theirs));
    }
    streams
}

#[test]
fn every_truncation_is_an_error() {
    for (mode, data, count, stride, _) in streams() {
        for length in 0..data.len() {
            assert!(decode(mode, &data[..length], count, stride).is_err(), "{mode:?} cut to {length}");
        }
        assert!(
            decode(mode, &[&data[..], &[0]].concat(), count, stride).is_err(),
            "{mode:?} and a byte more"
        );
    }
}

#[test]
fn damaged_bytes_are_refused_or_decode_as_by_the_library() {
    let mut random = Random(17);
    let (mut accepted, mut refused) = (0, 0);
    for (mode, data, count, stride, theirs) in streams() {
        for _ in 0..2000 {
            let mut damaged = data.clone();
            for _ in 0..=random.below(4) {
                let at = random.below(damaged.len());
                damaged[at] = random.next() as u8;
            }
            match decode(mode, &damaged, count, stride) {
                Ok(decoded) => {
                    assert!(theirs(&damaged, count) == Some(decoded), "{mode:?} {damaged:?}");
                    accepted += 1;
                }
                Err(_) => refused += 1,
            }
        }
    }
    assert!(accepted > 1000 && refused > 1000, "{accepted} {refused}");
}

#[test]
fn counts_that_the_bytes_cannot_hold_are_refused_before_anything_is_reserved() {
    for (mode, data, _, stride, _) in streams() {
        for count in [3 << 20, 3 << 40, usize::MAX / 3 * 3] {
            assert_eq!(
                decode(mode, &data, count, stride),
                Err(MeshoptError::Truncated),
                "{mode:?}, {count} elements"
            );
        }
    }
    let stride = |mode, stride| decode(mode, &[0; 64], 3, stride).unwrap_err();
    for (mode, bytes) in [
        (PLAIN, 0),
        (PLAIN, 6),
        (PLAIN, 260),
        (Mode::Triangles, 1),
        (Mode::Indices, 8),
        (Mode::Attributes(Some(Filter::Octahedral)), 12),
        (Mode::Attributes(Some(Filter::Quaternion)), 4),
    ] {
        assert_eq!(stride(mode, bytes), MeshoptError::Stride(bytes));
    }
    assert_eq!(decode(Mode::Triangles, &[0xe1; 64], 4, 2), Err(MeshoptError::Triangles(4)));
}
