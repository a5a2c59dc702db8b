//! The bytes that preparation gives, under both codecs, as they were when the format got its version: whoever
//! changes them changes the format.

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
3cb263aeb83bf305 000107f3cfdf23aa noisy sphere
6793c07385bc2dce fb50bb7c62be8e64 torus
2ee168dbb61687bf 73f6e5fefbbfbfa6 height field with holes
dae1dacddddc7033 0f60d5188dcffc67 boxes with seams everywhere
8bcf0f146619b029 6656b92324d5029b flat-shaded sphere
cd304a6aab3980bc 4ae86ba4f1bd97d8 several materials
8cc176a33a691131 38b90cccbb316171 many components
1339e02de8fbdd4a d68157d39e901b45 triangle soup
5db688f1f4a8e5a7 89b556dddca2f7dd non-manifold fans
7c29f6af1927310c 611f6005fa406d25 duplicate faces
0b909a430dd59016 4414190ebdab0c34 two coincident sheets
9c1bcb32156d2996 8a38c356dca4feca bow ties
74fde3a152fd2099 a5b22d5d247c29f7 needles
7583de781a4f36ec 0c38d87b2d7acb31 medley
f0b0fd7a3a66efc9 cc21255072f9b751 painted torus
";
