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
602671f82ff63706 ac05e2ac66318758 torus
2ee168dbb61687bf 73f6e5fefbbfbfa6 height field with holes
92d9da5696764d03 a2ef4234d7f3eb69 boxes with seams everywhere
54c32da138222797 2493bbb5d6380420 flat-shaded sphere
c5f91e8266cb40d3 3906d7c60d806f56 several materials
8cc176a33a691131 38b90cccbb316171 many components
14171b249ed14afe 13cfdd8ae6fe89cf triangle soup
b9b81647c015cce8 58c81ac547a2fb24 non-manifold fans
65c407828ccdf490 73763e9719bb9102 duplicate faces
d49a64850b770c97 f4c2cb31fafef5e0 two coincident sheets
9c1bcb32156d2996 8a38c356dca4feca bow ties
9f5bed24bad069fb 8551bf948e976719 needles
55d91cfbb6fdddc0 cf7eae5fff0970ad medley
1846b49b0729c89b 493d2aa28da02eaf painted torus
";
