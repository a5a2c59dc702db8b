//! A peer's nodes as pieces for the loader.

use lodestream_geometry::index::Sphere;

use super::offer::{Offer, Piece};
use crate::peers::{Node, Peer};

/// The peer's pieces of an asset: the index, then its nodes. `origin` is the origin of the asset's grid.
#[must_use]
pub fn offer(peer: &Peer, origin: [f64; 3]) -> Offer {
    let index = Piece {
        bytes: peer.index_bytes,
        error: 0.0,
        sphere: Sphere { center: [0.0; 3], radius: 0.0 },
        parents: Vec::new(),
        draws: false,
    };
    // Spheres are f32 everywhere.
    let piece = |node: &Node| Piece {
        bytes: node.bytes,
        error: node.error,
        sphere: Sphere {
            center: [0, 1, 2].map(|k| (node.center[k] - origin[k]) as f32),
            radius: node.radius,
        },
        parents: vec![0],
        draws: true,
    };
    let mut pieces: Vec<Piece> = std::iter::once(index).chain(peer.nodes.iter().map(piece)).collect();
    for (number, node) in (1_u32..).zip(&peer.nodes) {
        for &child in &node.children {
            pieces[child as usize + 1].parents.push(number);
        }
    }
    Offer { pieces }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peers;

    const EXAMPLE: &str = include_str!("../../../peers/example.json");

    #[test]
    fn the_example_is_read_and_its_roots_are_those_without_parents() {
        let peers = peers::parse(EXAMPLE, "example.json").unwrap();
        assert_eq!(peers.len(), 2);
        let offer = offer(&peers[1], [1.0, 0.0, 0.0]);
        assert_eq!(offer.roots().collect::<Vec<_>>(), [1, 2], "two roots after the index");
        let shared = &offer.pieces[4];
        assert_eq!(shared.parents, [0, 1, 2], "the index, and both roots");
        assert_eq!(shared.sphere.center[0], peers[1].nodes[3].center[0] as f32 - 1.0);
        assert_eq!(offer.bytes(), peers[1].index_bytes + peers[1].nodes.iter().map(|n| n.bytes).sum::<u64>());
    }
}
