//! The base mesh coder: a traversal over gates (directed edges), after Edgebreaker (Rossignac, 1999), for any
//! triangle soup. Faces that no gate reaches start new components as seed faces.
//!
//! Predictions keep the symbols cheap: a gate's third vertex is likely to be next to it on the border ([`border`]); a
//! component may repeat an earlier one ([`repeats`]); and in meshes of straight, flat parts a number often equals an
//! earlier one ([`candidates`]).

mod blob;
mod border;
mod candidates;
pub(crate) mod mesh;
mod position_candidates;
mod repeats;
mod target;
mod uv_candidates;
mod vertices;
mod walk;
mod wedges;

use crate::codec::base::mesh::{BaseFormat, BaseMesh, BothCodecs, OrderedBase};
use crate::codec::base::target::TargetMesh;
use crate::codec::base::walk::Walk;
use crate::codec::model::{STREAMS, contexts};
use crate::codec::numbering::Numbering;
use crate::entropy::Codec;
use crate::entropy::allocation_limit::{max_elements, min_bytes};
use crate::entropy::null_coder::NullCoder;
use crate::entropy::range_coder::{Coder, Decoder, Encoder};
use crate::entropy::zstd_streams::{ZstdStreamDecoder, ZstdStreamEncoder};
use crate::error::DecodeError;

/// Reorders a mesh into traversal order. Fails as [`encode`] does.
pub(crate) fn ordered(mesh: &BaseMesh, format: BaseFormat) -> Result<OrderedBase, DecodeError> {
    encode_with(&mut NullCoder, mesh, format, false)
}

/// Encodes a mesh given in any order. Fails on more than [`crate::base::MAX_BASE_FACES`] faces and on faces with a
/// repeated vertex.
pub(crate) fn encode(mesh: &BaseMesh, codec: Codec, format: BaseFormat) -> Result<Vec<u8>, DecodeError> {
    let range = encode_range(mesh, format)?;
    match codec {
        Codec::Range | Codec::AxisAligned => Ok(range.bytes),
        Codec::Zstd => encode_zstd(mesh, format, range.chooses),
    }
}

/// Encodes with both codecs: three traversals, as many as for the zstd codec alone.
pub(crate) fn encode_both(mesh: &BaseMesh, format: BaseFormat) -> Result<BothCodecs, DecodeError> {
    let range = encode_range(mesh, format)?;
    let plain = encode_zstd(mesh, format, range.chooses)?;
    Ok(BothCodecs { range: range.bytes, plain })
}

/// A range-coded mesh, and whether candidates are chosen explicitly.
struct RangeCoded {
    bytes: Vec<u8>,
    chooses: bool,
}

fn encode_range(mesh: &BaseMesh, format: BaseFormat) -> Result<RangeCoded, DecodeError> {
    let traverse = |chooses| -> Result<RangeCoded, DecodeError> {
        let mut encoder = Encoder::new(contexts());
        let ordered_base = encode_with(&mut encoder, mesh, format, chooses)?;
        Ok(RangeCoded { bytes: encoder.finish(min_bytes(ordered_base.mesh.elements())), chooses })
    };
    // Choosing candidates pays for straight parts and costs for round ones: both are tried.
    let (without_choice, choosing) = (traverse(false)?, traverse(true)?);
    Ok(if choosing.bytes.len() < without_choice.bytes.len() { choosing } else { without_choice })
}

/// The zstd codec uses the choice made for the range coder.
fn encode_zstd(mesh: &BaseMesh, format: BaseFormat, chooses: bool) -> Result<Vec<u8>, DecodeError> {
    let mut encoder = ZstdStreamEncoder::new(&STREAMS);
    let ordered_base = encode_with(&mut encoder, mesh, format, chooses)?;
    Ok(encoder.finish(min_bytes(ordered_base.mesh.elements())))
}

/// Encodes a mesh with any coder, with or without explicit choice of candidates.
pub(crate) fn encode_with<C: Coder>(
    coder: &mut C,
    mesh: &BaseMesh,
    format: BaseFormat,
    choosing: bool,
) -> Result<OrderedBase, DecodeError> {
    let mut walk = Walk::new(coder, format, u64::MAX, choosing);
    walk.target = Some(TargetMesh::new(mesh));
    walk.run()?;
    let Numbering { vertices, wedges, faces, .. } =
        walk.target.map_or_else(Default::default, |wanted| wanted.names);
    Ok(OrderedBase { mesh: walk.mesh, vertices, wedges, faces })
}

/// Decodes a mesh.
pub(crate) fn decode(bytes: &[u8], codec: Codec, format: BaseFormat) -> Result<BaseMesh, DecodeError> {
    let most = max_elements(bytes.len());
    match codec {
        Codec::Range | Codec::AxisAligned => {
            let mut decoder = Decoder::new(contexts(), bytes);
            let mesh = decode_with(&mut decoder, format, most)?;
            decoder.end(min_bytes(mesh.elements()))?;
            Ok(mesh)
        }
        Codec::Zstd => {
            let mut decoder = ZstdStreamDecoder::new(&STREAMS, bytes)?;
            let mesh = decode_with(&mut decoder, format, most)?;
            decoder.end(min_bytes(mesh.elements()))?;
            Ok(mesh)
        }
    }
}

fn decode_with<C: Coder>(
    coder: &mut C,
    format: BaseFormat,
    max_elements: u64,
) -> Result<BaseMesh, DecodeError> {
    let mut walk = Walk::new(coder, format, max_elements, false);
    walk.run()?;
    Ok(walk.mesh)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::MAX_BASE_FACES;
    use crate::codec::model::{BASE_GATE, BASE_LIKELY_VERTEX, BASE_MORE};
    use crate::mesh::{Attributes, Face, Kinds, Wedge};

    /// Encodes the decisions that make the mesh grow as true.
    struct Greedy(Encoder);

    impl Coder for Greedy {
        fn bit(&mut self, context: usize, value: bool) -> bool {
            let grow = context == BASE_MORE || (BASE_GATE..BASE_LIKELY_VERTEX).contains(&context);
            self.0.bit(context, grow || value)
        }
        fn mix<const N: usize>(&mut self, contexts: [usize; N], mixer: usize, value: bool) -> bool {
            self.0.mix(contexts, mixer, value)
        }
        fn raw(&mut self, bits: u32, value: u32) -> u32 {
            self.0.raw(bits, value)
        }
        fn check(&self) -> Result<(), DecodeError> {
            Ok(())
        }
    }

    /// A box from `low` to `high`; each side has its own chart, projected along its axis, at 8 texels per cell.
    fn add_box(mesh: &mut BaseMesh, low: [i32; 3], high: [i32; 3]) {
        const QUADS: [[u32; 4]; 6] =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let first = mesh.positions.len() as u32;
        let corner = |v: u32| [0, 1, 2].map(|axis| if v >> axis & 1 == 1 { high[axis] } else { low[axis] });
        mesh.positions.extend((0..8).map(corner));
        for (side, quad) in QUADS.into_iter().enumerate() {
            let start = mesh.wedges.len() as u32;
            let across = [0, 1, 2].map(|axis| axis != 2 - side / 2);
            mesh.wedges.extend(quad.map(|v| {
                let mut plane =
                    corner(v).into_iter().zip(across).filter_map(|(x, across)| across.then_some(8 * x + 5));
                let uv = [plane.next().unwrap(), plane.next().unwrap()];
                Wedge {
                    vertex: first + v,
                    attributes: Attributes { uv, group: side as u32, ..Attributes::default() },
                }
            }));
            for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
                mesh.faces.push(Face { wedges: [start + a, start + b, start + c], material: 0 });
            }
        }
    }

    fn bytes_of(mesh: &BaseMesh) -> usize {
        let kinds = Kinds { uv_bits: 12, ..Kinds::default() };
        let format = BaseFormat { bits: 9, kinds, materials: 1, parts: 1, uv_ratios: [1.0; 2] };
        let mut ordered_base = None;
        for codec in [Codec::Zstd, Codec::Range] {
            let bytes = encode(mesh, codec, format).unwrap();
            let ordered = ordered(mesh, format).unwrap();
            assert!(decode(&bytes, codec, format).unwrap() == ordered.mesh, "{codec:?}");
            let both = encode_both(mesh, format).unwrap();
            let same = if codec == Codec::Range { both.range } else { both.plain };
            assert!(same == bytes, "{codec:?}: encode_both gives other bytes");
            ordered_base = Some(bytes.len());
        }
        ordered_base.unwrap()
    }

    #[test]
    fn repeated_boxes_cost_a_few_bytes_each() {
        let row = |stones: i32| {
            let mut mesh = BaseMesh::default();
            for i in 0..stones {
                add_box(&mut mesh, [7 * i + 3, 11, 40], [7 * i + 9, 24, 61]);
            }
            bytes_of(&mesh)
        };
        let [one, few, many] = [1, 8, 40].map(row);
        assert!(one < 100, "one stone: {one} bytes");
        assert!(many - few < 32 * 4, "32 stones more: {} bytes", many - few);
    }

    #[test]
    fn boxes_with_shared_heights_cost_less() {
        let wall = |step: i32| {
            let mut mesh = BaseMesh::default();
            for i in 0..24 {
                // Lengths and corner order vary irregularly, rows regularly.
                let (x, length) = ((i * 37) % 101 * 4, 5 + (i * i * 13) % 23);
                let low = [x, 100 + 20 * (i % 3) + step * (i * i % 7), 40 + step * (i * 3 % 5)];
                add_box(
                    &mut mesh,
                    low,
                    [x + length, low[1] + 20 + step * (i % 4), low[2] + 30 + step * (i * i % 3)],
                );
            }
            bytes_of(&mesh)
        };
        let (level, uneven) = (wall(0), wall(9));
        assert!(level * 4 < uneven * 3, "{level} and {uneven} bytes");
    }

    #[test]
    fn a_million_faces_in_a_few_kilobytes_are_refused_before_allocation() {
        let mut greedy = Greedy(Encoder::new(contexts()));
        let format =
            BaseFormat { bits: 12, kinds: Kinds::default(), materials: 1, parts: 1, uv_ratios: [1.0; 2] };
        let mut walk = Walk::new(&mut greedy, format, u64::MAX, false);
        assert!(walk.run().is_err());
        assert_eq!(walk.mesh.faces.len(), MAX_BASE_FACES);
        let bytes = greedy.0.finish(0);
        assert!(bytes.len() < MAX_BASE_FACES / 32, "{} bytes", bytes.len());
        let mut decoder = Decoder::new(contexts(), &bytes);
        let mut walk = Walk::new(&mut decoder, format, max_elements(bytes.len()), false);
        let why = walk.run().unwrap_err().to_string();
        assert!(why.contains("more faces than its bytes allow"), "{why}");
        assert!(walk.mesh.elements() <= max_elements(bytes.len()) + 6);
    }
}
