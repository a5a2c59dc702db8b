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
359c8efefdb5bfa6 60772004b2f270cf ed5565c694546c04 noisy sphere
90abe0eca4971dd5 3148e32c3f3a9cf2 e2574ebf33e4086a torus
62dcdba7363ed2bb 13d8e2905f4c3755 b182d4697767db6d height field with holes
cd18f786f1312339 4a764f0bb1add068 775be775a1af2646 boxes with seams everywhere
7714863b4dd53197 c87a5211c4e260b0 1ab3194cd0cedd7e flat-shaded sphere
bdf8ca6353990fd6 3f254ec2ecb5bdc0 1c455136bd271734 several materials
d8000ed366ab5b31 30bc110a9fec7837 ccb04de2ff149696 many components
c7381086ebcff9b0 befe68101a7a951f e355f3074e4c4e3f triangle soup
3d68619e2f57f837 d5221667e2b74f21 523dabd046ca6ca3 non-manifold fans
2893c3b5a93f77a9 cdf5ab0617c43442 7a639b0e8905dfa6 duplicate faces
da7dc2c800311f11 941f4d3c76faa60d 3990fa9cdd28c3d4 two coincident sheets
fa200790b55542c3 a6fd7623ea74f370 689dc3e577babe7a bow ties
28e5d97432603b61 530e70a361e203a7 42acc5b92a8a919d needles
d128c7e6348e36b9 77844cdc958d29a2 2a8311186679a371 medley
12cb11c7726656d3 62ce1d6e6dc44740 c418704fdc240874 painted torus
c2f6bd3fbd8587af 9f575b4b568ad248 de7f86b1749e5152 dressed stones
5084c3a2d408d7ff 543b6ad16faf7873 865500a262481beb parts of one component each
d546a05e2183f49e dc43bd43273b37e9 977e1fd355e4f53b parts that touch
7697e5905b6df98e 6bc661c1cc2ec5d5 ff6cab1726cfa494 skinned torus
f9de94e777351b7d 1f27acd9e1ceac12 68ba8362bf895439 lightmapped torus
";
