//! Byte-exact results of preparation for each codec at the current format version. A change here is a change of the
//! format, or of the prepared meshes, which needs a new version of the preparation settings.

use lodestream_geometry::prepare::{Prepared, suit};
use lodestream_geometry::{Codec, Settings};

use crate::common::{self, prepared, quantised, with_truncation_points};

fn hash(prepared: &Prepared) -> String {
    let mut hasher = blake3::Hasher::new();
    let base = prepared.base.encode().unwrap();
    for blob in [&base].into_iter().chain(&prepared.pages).chain(&prepared.chunks) {
        hasher.update(&(blob.len() as u64).to_le_bytes()).update(blob);
    }
    hasher.finalize().to_hex()[..16].to_string()
}

#[test]
fn prepared_bytes_equal_the_golden_hashes() {
    let mut found = String::new();
    for (name, source) in common::all() {
        let mesh = quantised(&source);
        let of = |codec| {
            let mut mesh = mesh.clone();
            suit(&mut mesh, codec);
            hash(&prepared(&mesh, &Settings { codec, ..with_truncation_points(400) }))
        };
        let [range, zstd, axis_aligned] = [Codec::Range, Codec::Zstd, Codec::AxisAligned].map(of);
        found += &format!("{range} {zstd} {axis_aligned} {name}\n");
    }
    assert_eq!(found, GOLDEN);
}

/// Hashes of the blobs with the codecs range, zstd and axis-aligned.
const GOLDEN: &str = "\
4d78338dd744b772 6d83b8e1212c33fe 0334a9ee12ea3dbc noisy sphere
8607669b00f4d29c 86ecae3803ea4d8c 4816db5cb57d660c torus
94681fd7be1a7491 b7bd47b908a57a76 59f8266e966528f1 height field with holes
94f29e022eb051c1 dd935027bb2e6246 cd45f46537c8ba13 boxes with seams everywhere
3462c4747d7113f4 bd60c4935b9ec924 c042bc97ca0712ee flat-shaded sphere
3f6c6127861a4d39 00c6ed2853f6b602 e9e365d715e63df6 several materials
f305d607208f855c ead9fddec6fa6d14 9ef81504ea2002f5 many components
c5a073b8c466b6cd 3c54d58a7c76242f f6913becd516fdd6 triangle soup
9af1260e2b2f39e7 adb1b88c948185f2 ccdd3df9aeb1754d non-manifold fans
88a0e085b82a288b 10b4201b349ff809 791c9101bb201d44 duplicate faces
0841e2da0b1378d3 3eb604da326f19f0 496cf987e991ce53 two coincident sheets
63273b45f266e148 4e7b9d72f83c2a3f bf6d7f803fb4671f bow ties
7ea8d5ea364d9970 0b7755817f964287 d0c22240636b48cb needles
326ebf1a373aa72c 7927564ecac93994 be54d18f242d8663 medley
7f5746fb8dba7404 0869a62df4f86e65 500acbeec928e3db painted torus
3d1f8d52a42593b3 816af195627f4871 59ab84a0ce7cfc03 dressed stones
7051dc25b4e9a104 3c93780cbef72c52 73e7a3ccd5e49dd0 parts of one component each
f03045a0c19c85d2 7d6fe78265bbe556 8b8906c5b8024bd4 parts that touch
";
