//! The bytes that preparation gives, under both codecs, as they were when the format got its version: whoever
//! changes them changes the format, or what meshes become, which the recipe's version says.

use lodestream_geometry::prepare::Prepared;
use lodestream_geometry::{Codec, Settings};

use crate::common::{self, prepared, quantised, stopping};

fn hash(prepared: &Prepared) -> String {
    let mut hasher = blake3::Hasher::new();
    let base = prepared.base.encode().unwrap();
    for blob in [&base].into_iter().chain(&prepared.pages).chain(&prepared.chunks) {
        hasher.update(&(blob.len() as u64).to_le_bytes()).update(blob);
    }
    hasher.finalize().to_hex()[..16].to_string()
}

#[test]
fn the_same_meshes_give_the_same_bytes_as_ever() {
    let mut found = String::new();
    for (name, source) in common::all() {
        let mesh = quantised(&source);
        let of = |codec| hash(&prepared(&mesh, &Settings { codec, ..stopping(400) }));
        found += &format!("{} {} {name}\n", of(Codec::Range), of(Codec::Plain));
    }
    assert_eq!(found, GOLDEN);
}

/// Hashes of the range coder's and the plain coder's blobs.
const GOLDEN: &str = "\
4d78338dd744b772 6d83b8e1212c33fe noisy sphere
8607669b00f4d29c 86ecae3803ea4d8c torus
94681fd7be1a7491 b7bd47b908a57a76 height field with holes
94f29e022eb051c1 dd935027bb2e6246 boxes with seams everywhere
3462c4747d7113f4 bd60c4935b9ec924 flat-shaded sphere
3f6c6127861a4d39 00c6ed2853f6b602 several materials
f305d607208f855c ead9fddec6fa6d14 many components
c5a073b8c466b6cd 3c54d58a7c76242f triangle soup
9af1260e2b2f39e7 adb1b88c948185f2 non-manifold fans
88a0e085b82a288b 10b4201b349ff809 duplicate faces
0841e2da0b1378d3 3eb604da326f19f0 two coincident sheets
63273b45f266e148 4e7b9d72f83c2a3f bow ties
7ea8d5ea364d9970 0b7755817f964287 needles
326ebf1a373aa72c 7927564ecac93994 medley
7f5746fb8dba7404 0869a62df4f86e65 painted torus
";
