//! Small generated assets that the targets decode against.

use std::sync::OnceLock;

use lodestream_geometry::mesh::SourceMesh;
use lodestream_geometry::prepare::{Prepared, suit};
use lodestream_geometry::refine::ActiveMesh;
use lodestream_geometry::{Codec, Settings};

use crate::common::{prepared, quantised, shapes, with_truncation_points};

/// A prepared asset with its name.
pub struct Fixture {
    /// Its name.
    pub name: &'static str,
    /// Base mesh, index and chunks.
    pub asset: Prepared,
    /// By chunk: the mesh with every older chunk applied.
    pub before: Vec<ActiveMesh>,
}

/// The assets: seams and materials, non-manifold stars, vanishing components, seams nearly everywhere, stars of high
/// valence, all of these with colours and normals; some with the zstd codec, whose chunks are not compressed here; and
/// stones with the axis-aligned codec; several parts; skins; two sets of texture coordinates. A few hundred faces each, so
/// that one input takes well under a millisecond.
///
/// # Panics
/// If an asset does not decode.
#[allow(clippy::unwrap_used, reason = "assets that do not decode leave nothing to fuzz")]
pub fn all() -> &'static [Fixture] {
    static ALL: OnceLock<Vec<Fixture>> = OnceLock::new();
    ALL.get_or_init(|| {
        [
            ("torus", shapes::materials(shapes::torus(8, 10), 3), Codec::Range),
            ("fans", shapes::fans(16), Codec::Range),
            ("components", components(), Codec::Range),
            ("frigate", shapes::frigate(3), Codec::Range),
            ("poles", shapes::sphere(6, 30, 0.05), Codec::Range),
            ("medley", shapes::painted(shapes::medley(1)), Codec::Range),
            ("plain", shapes::painted(shapes::materials(shapes::torus(8, 10), 3)), Codec::Zstd),
            ("plain-components", components(), Codec::Zstd),
            ("axis-aligned", shapes::stones(6), Codec::AxisAligned),
            (
                "parts",
                shapes::parts(shapes::join(components(), &components(), [0.0, 4.0, 0.0]), 12),
                Codec::Range,
            ),
            ("skinned", shapes::skinned(shapes::materials(shapes::torus(8, 10), 3)), Codec::Range),
            ("plain-skinned", shapes::skinned(components()), Codec::Zstd),
            ("two-uvs", shapes::lightmapped(shapes::materials(shapes::torus(8, 10), 3), 2), Codec::Range),
            ("plain-two-uvs", shapes::lightmapped(shapes::frigate(3), 2), Codec::Zstd),
        ]
        .into_iter()
        .map(|(name, source, codec)| {
            let mut source = quantised(&source);
            suit(&mut source, codec);
            let asset = prepared(&source, &Settings { codec, ..with_truncation_points(50) });
            let mut mesh = ActiveMesh::new(&asset.base);
            let mut before = Vec::new();
            for (id, (info, payload)) in (0..).zip(asset.infos.iter().zip(&asset.chunks)) {
                before.push(mesh.clone());
                let delta = mesh.decode(id, info, payload).unwrap();
                mesh.apply(&delta).unwrap();
            }
            Fixture { name, asset, before }
        })
        .collect()
    })
}

/// A ball with cubes beside it.
fn components() -> SourceMesh {
    let cubes = (0..8).map(|i| [f64::from(i) * 0.3, 1.2, 0.1 * f64::from(i % 3)]);
    cubes.fold(shapes::sphere(6, 9, 0.05), |mesh, at| shapes::join(mesh, &shapes::cube(0.1), at))
}

#[cfg(test)]
mod tests {
    #[test]
    fn every_fixture_has_chunks_that_need_others() {
        for fixture in super::all() {
            let infos = &fixture.asset.infos;
            assert!(infos.len() >= 4, "{}: {} chunks", fixture.name, infos.len());
            assert!(infos.iter().any(|i| !i.parents.is_empty()), "{}", fixture.name);
            assert!(fixture.asset.base.totals.faces < 1000, "{}", fixture.name);
        }
    }
}
