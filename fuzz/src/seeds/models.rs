//! Model files.

use data_encoding::BASE64;
use lodestream_geometry::mesh::SourceMesh;

use super::seed::seed;
use crate::common::shapes;
use crate::glb::glb;

/// The text of an OBJ file.
fn obj(mesh: &SourceMesh) -> String {
    use std::fmt::Write as _;
    let mut text = String::from("mtllib m.mtl\n");
    for [x, y, z] in &mesh.positions {
        let _ = writeln!(text, "v {x:.3} {y:.3} {z:.3}");
    }
    for [u, v] in &mesh.uvs {
        let _ = writeln!(text, "vt {u:.2} {v:.2}");
    }
    for [x, y, z] in &mesh.normals {
        let _ = writeln!(text, "vn {x:.2} {y:.2} {z:.2}");
    }
    for (face, material) in mesh.faces.iter().zip(&mesh.materials) {
        let _ = write!(text, "usemtl m{material}\nf");
        for corner in face {
            let given = |index: u32| if index == u32::MAX { String::new() } else { (index + 1).to_string() };
            let _ = write!(text, " {}/{}/{}", corner.position + 1, given(corner.uv), given(corner.normal));
        }
        text.push('\n');
    }
    text
}

/// A pyramid on a quad in every format, with all vertex properties and with positions only, and a strip.
pub(super) fn scans() -> Vec<(String, Vec<u8>)> {
    let full = "property double x\nproperty short y\nproperty float z\nproperty float nx\nproperty float ny\nproperty float nz\n\
                property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float s\nproperty float t\n";
    let faces = "element face 5\nproperty list uchar int vertex_indices\nend_header\n";
    let places = [[0_i16, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0], [2, 2, 3]];
    let polygons: [&[i32]; 5] = [&[0, 3, 2, 1], &[0, 1, 4], &[1, 2, 4], &[2, 3, 4], &[3, 0, 4]];
    let head =
        |format: &str, rest: &str| format!("ply\nformat {format} 1.0\nelement vertex 5\n{rest}").into_bytes();
    let binary = |format: &str, big: bool| {
        let mut out = head(format, &format!("{full}{faces}"));
        let mut put = |bytes: &[u8]| match big {
            true => out.extend(bytes.iter().rev()),
            false => out.extend(bytes),
        };
        for [x, y, z] in places {
            put(&f64::from(x).to_le_bytes());
            put(&y.to_le_bytes());
            [f32::from(z), 0.0, 0.6, 0.8].iter().for_each(|x| put(&x.to_le_bytes()));
            [x, y, z].iter().for_each(|x| put(&[*x as u8 * 60]));
            [x, y].iter().for_each(|x| put(&(f32::from(*x) / 4.0).to_le_bytes()));
        }
        for polygon in polygons {
            put(&[polygon.len() as u8]);
            polygon.iter().for_each(|corner| put(&corner.to_le_bytes()));
        }
        out
    };
    let vertices: String = places.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    let listed = |polygon: &&[i32]| {
        let corners: Vec<String> = polygon.iter().map(ToString::to_string).collect();
        format!("{} {}\n", polygon.len(), corners.join(" "))
    };
    let listed: String = polygons.iter().map(listed).collect();
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let text = |rest: &str| [head("ascii", &format!("{xyz}{rest}")), vertices.clone().into()].concat();
    let strips = "element tristrips 1\nproperty list int int vertex_indices\nend_header\n";
    let extra = "element edge 1\nproperty int a\nelement face 5\nproperty list uchar int vertex_index\nproperty float area\n\
                 comment x\nend_header\n";
    let areas = listed.replace('\n', " 0.5\n");
    vec![
        seed("text", [text(faces), listed.into_bytes()].concat()),
        seed("strip", [text(strips), b"8 0 1 4 2 -1 3 0 4\n".to_vec()].concat()),
        seed("passed-over", [text(extra), b"9\n".to_vec(), areas.into_bytes()].concat()),
        seed("textures", textured(vertices.clone())),
        seed("stl-text", stl_text().into_bytes()),
        seed("stl-binary", stl_binary()),
        seed("little-endian", binary("binary_little_endian", false)),
        seed("big-endian", binary("binary_big_endian", true)),
    ]
}

/// A square with textures of its faces, numbers that are too many, and comments among the elements.
fn textured(vertices: String) -> Vec<u8> {
    let head = "ply\nformat ascii 1.0\ncomment TextureFile a.png\ncomment TextureFile b\\c.png\nelement vertex 5\n\
                property float x\nproperty float y\nproperty float z\nelement face 2\n\
                property list uchar int vertex_indices\nproperty list uchar float texcoord\nproperty int texnumber\n\
                end_header\n";
    let faces = "# x\n3 0 1 2 6 0 0 1 0 1 1 1\ncomment x\n3 0 2 3 6 0 0 1 1 0 1 0 7 8\n";
    [head, &vertices, faces].concat().into_bytes()
}

/// The corners of two triangles.
const FACETS: [[[f32; 3]; 3]; 2] = [
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.5]],
    [[0.0, 0.0, 0.0], [1.0, 1.0, 0.5], [0.0, 1.0, 0.0]],
];

fn stl_text() -> String {
    use std::fmt::Write as _;
    let mut text = String::from("solid a\n");
    for corners in FACETS {
        text += "facet normal 0 0 1\nouter loop\n";
        for [x, y, z] in corners {
            let _ = writeln!(text, "vertex {x} {y} {z}");
        }
        text += "endloop\nendfacet\n";
    }
    text + "endsolid a\n"
}

fn stl_binary() -> Vec<u8> {
    let mut out = b"solid".to_vec();
    out.resize(80, 0);
    out.extend((FACETS.len() as u32).to_le_bytes());
    for corners in FACETS {
        let values = [[0.0, 0.0, 1.0]].into_iter().chain(corners).flatten();
        out.extend(values.flat_map(f32::to_le_bytes));
        out.extend([0, 0]);
    }
    out
}

pub(super) fn models() -> Vec<(String, Vec<u8>)> {
    const MTL: &str = "newmtl m0\nKd 0.5 0.25 1\nd 0.5\nNs 10\nmap_Kd -s 2 2 1 a b.png\nbump -bm 0.25 h.png\n\
                       newmtl m1\nKd 0.5\nTr 0.25\ndisp -mm 0 1 d.png\n\
                       newmtl m2\nKe 1 2 0.5\nPr 0.5\nPm 1\nillum 0\nmap_Kd -clamp on a.png\nmap_Ke e.png\n\
                       map_Pr -imfchan g s.png\nmap_Pm -imfchan b s.png\nmap_d a.png\nnorm -bm 0.5 n.png\n";
    let texts = [
        ("torus", obj(&shapes::materials(shapes::torus(3, 4), 2))),
        ("frigate", obj(&shapes::frigate(1)).lines().take(40).map(|l| format!("{l}\n")).collect::<String>() + "f 1 2 3\n"),
        ("relative", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv .5 .2 0\nf -5 -4 -3 -2 -1\n".into()),
        ("odd", "\u{feff}# x\r\nf 1/1 2/1 \\\r\n  3/1 # f\r\nv 0 0 0 2\r\nv 2 0 0 2\r\nv 0 1 0 1 0 0\r\nvt 0.5\r\nl 1 2\r\n".into()),
        ("concave", "v 0 2 0\nv -1 0 0\nv 0 1 0\nv 1 0 0\nvn 0 0 4\nusemtl a b\nf 1//1 2//1 3//1 4//1\n".into()),
    ];
    let tiles = "mtllib m.mtl\nusemtl t\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1.5 1\nvt -1 0\nvt 9 899\n\
                 f 1/1 2/1 3/1\nf 1/2 2/2 3/2\nf 1/3 2/3 3/3\nf 1/4 2/4 3/4\nf 1 2 3\n";
    let set = "newmtl t\nmap_Kd a.<UDIM>.png\nmap_d b/<UDIM>.png\nmap_Pm <UDIM>-<UDIM>.png\nnorm n.png\n";
    let mut seeds: Vec<_> =
        texts.map(|(name, text)| seed(name, [text.as_bytes(), b"\0", MTL.as_bytes()].concat())).into();
    seeds.push(seed("tiles", [tiles.as_bytes(), b"\0", set.as_bytes()].concat()));
    seeds
}

/// The beginning of a material with all properties, and the textures that it uses.
const MAPS: &str = r#""images":[{"uri":"a.png"},{"bufferView":1,"mimeType":"image/png"}],"samplers":[{"wrapS":33071,"wrapT":33648}],"textures":[{"source":0,"sampler":0},{"source":1,"sampler":0}],"extensionsUsed":["KHR_materials_emissive_strength"],"extensionsRequired":["KHR_materials_transmission"],"materials":[{"normalTexture":{"index":0,"scale":0.5,"extensions":{"KHR_texture_transform":{"offset":[0.5,0],"rotation":1,"scale":[2,1]}}},"occlusionTexture":{"index":1,"strength":0.5,"texCoord":1},"emissiveTexture":{"index":0},"emissiveFactor":[1,0.5,0],"alphaMode":"MASK","alphaCutoff":0.25,"doubleSided":true,"extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":4},"KHR_materials_unlit":{},"KHR_materials_transmission":{"transmissionFactor":0.5},"KHR_materials_pbrSpecularGlossiness":{"diffuseFactor":[0,0,0,1],"glossinessFactor":0.5,"specularGlossinessTexture":{"index":1}}},"name":"m","#;

/// The beginning of a material with textures of extensions.
const IMAGES: &str = r#""images":[{"uri":"a.png"},{"uri":"a.ktx2"},{"uri":"a.avif"}],"textures":[{"source":0,"extensions":{"KHR_texture_basisu":{"source":1}}},{"extensions":{"EXT_texture_avif":{"source":2}}}],"extensionsRequired":["KHR_texture_basisu","EXT_texture_avif"],"materials":[{"normalTexture":{"index":0},"emissiveTexture":{"index":1},"emissiveFactor":[1,1,1],"name":"m","#;

/// Nodes with lights of every kind, and the lights.
const LIGHTS: &str = r#""extensionsRequired":["KHR_lights_punctual"],"extensions":{"KHR_lights_punctual":{"lights":[{"type":"point","color":[1,0.5,0],"intensity":40,"range":9},{"type":"spot","intensity":9,"spot":{"innerConeAngle":0.25,"outerConeAngle":0.5}},{"type":"directional"}]}},"nodes":[{"mesh":0,"children":[1,2,3]},{"translation":[1,2,3],"extensions":{"KHR_lights_punctual":{"light":0}}},{"scale":[2,-1,0.5],"extensions":{"KHR_lights_punctual":{"light":1}}},{"extensions":{"KHR_lights_punctual":{"light":2}}}]"#;

/// Nodes that move: every interpolation, and a channel that cannot be read.
const ANIMATION: &str = r#""nodes":[{"mesh":0,"children":[1]},{"mesh":0,"translation":[2,0,0]}],"animations":[{"name":"go","channels":[{"sampler":0,"target":{"node":0,"path":"translation"}},{"sampler":1,"target":{"node":1,"path":"scale"}},{"sampler":2,"target":{"node":1,"path":"translation"}},{"sampler":0,"target":{"node":0,"path":"rotation"}},{"sampler":0,"target":{"node":0,"path":"weights"}}],"samplers":[{"input":3,"output":4},{"input":3,"output":4,"interpolation":"STEP"},{"input":3,"output":5,"interpolation":"CUBICSPLINE"}]}]"#;

/// The beginning of a material whose maps use two sets of texture coordinates, and a third.
const TWO_UVS: &str = r#""images":[{"uri":"a.png"}],"textures":[{"source":0}],"materials":[{"normalTexture":{"index":0},"occlusionTexture":{"index":0,"texCoord":1},"emissiveTexture":{"index":0,"extensions":{"KHR_texture_transform":{"scale":[2,3]}}},"emissiveFactor":[1,1,1],"name":"m","#;

/// Nodes with a skin and weights of morph targets.
const SKIN: &str = r#""skins":[{"joints":[1,2]}],"nodes":[{"mesh":0,"skin":0,"weights":[0.5,0.25]},{"children":[2],"translation":[0,7,0]},{"scale":[1,-2,1]}]"#;

pub(super) fn scenes() -> Vec<(String, Vec<u8>)> {
    // Four corners of a square, their uvs, six indices.
    let mut bin: Vec<u8> = Vec::new();
    for (x, y) in [(0.0_f32, 0.0_f32), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
        bin.extend([x, y, 0.5 * x * y].iter().flat_map(|c| c.to_le_bytes()));
    }
    bin.extend([0, 0, 255, 0, 255, 255, 0, 255]);
    bin.extend([0, 1, 2, 0, 2, 3]);
    let views = r#""bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":8},{"buffer":0,"byteOffset":56,"byteLength":6}]"#;
    let accessors = r#""accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":4,"min":[0,0,0],"max":[1,1,1]},{"bufferView":1,"componentType":5121,"normalized":true,"type":"VEC2","count":4},{"bufferView":2,"componentType":5121,"type":"SCALAR","count":6}]"#;
    let file = |buffer: &str, mode: u8, nodes: &str, more: &str| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],{nodes},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"indices":2,"mode":{mode}{more}}}]}}],"buffers":[{{{buffer}"byteLength":62}}],{views},{accessors},"materials":[{{"name":"m","pbrMetallicRoughness":{{"baseColorFactor":[1,0.5,0,1],"roughnessFactor":0.3}}}}]}}"#
        )
    };
    let one = r#""nodes":[{"mesh":0}]"#;
    let nested = r#""nodes":[{"children":[1,2],"translation":[1,2,3]},{"mesh":0,"rotation":[0,0.6,0,0.8],"scale":[2,2,2]},{"mesh":0,"matrix":[1,0,0,0,0,-1,0,0,0,0,3,0,0,0,5,1]}]"#;
    let places = r#""extensionsRequired":["EXT_mesh_gpu_instancing"],"nodes":[{"mesh":0,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":0,"SCALE":0}}}}]"#;
    let data = format!(r#""uri":"data:application/octet-stream;base64,{}","#, BASE64.encode(&bin));
    vec![
        seed("square.glb", glb(&file("", 4, one, r#","material":0"#), &bin)),
        seed("strip.glb", glb(&file("", 5, one, ""), &bin)),
        seed("fan.glb", glb(&file("", 6, nested, r#","material":0"#), &bin)),
        seed("nodes.glb", glb(&file("", 4, nested, ""), &bin)),
        seed("places.glb", glb(&file("", 4, places, ""), &bin)),
        seed("data-uri.gltf", file(&data, 4, nested, "").into_bytes()),
        seed("materials.glb", glb(&file("", 4, one, r#","material":0"#).replace(r#""materials":[{"name":"m","#, MAPS), &bin)),
        seed("images.glb", glb(&file("", 4, one, r#","material":0"#).replace(r#""materials":[{"name":"m","#, IMAGES), &bin)),
        seed("skin.glb", glb(&file("", 4, SKIN, r#","targets":[{"POSITION":0},{"POSITION":0,"NORMAL":0}]"#).replace(r#""TEXCOORD_0":1}"#, r#""TEXCOORD_0":1,"JOINTS_0":3,"WEIGHTS_0":3}"#).replace(r#""type":"SCALAR","count":6}]"#, r#""type":"SCALAR","count":6},{"bufferView":0,"componentType":5121,"type":"VEC4","count":4}]"#), &bin)),
        seed("animation.glb", glb(&file("", 4, ANIMATION, "").replace(r#""type":"SCALAR","count":6}]"#, r#""type":"SCALAR","count":6},{"bufferView":0,"byteOffset":8,"componentType":5126,"type":"SCALAR","count":2},{"bufferView":0,"componentType":5126,"type":"VEC3","count":2},{"bufferView":0,"componentType":5121,"normalized":true,"type":"VEC3","count":6}]"#), &bin)),
        seed("two-uvs.glb", glb(&file("", 4, one, r#","material":0"#).replace(r#""TEXCOORD_0":1}"#, r#""TEXCOORD_0":1,"TEXCOORD_1":1}"#).replace(r#""materials":[{"name":"m","#, TWO_UVS), &bin)),
        seed("lights.glb", glb(&file("", 4, LIGHTS, ""), &bin)),
        seed("sparse.glb", glb(&file("", 4, one, "").replace(r#","count":4,"min":[0,0,0]"#, r#","count":4,"sparse":{"count":1,"indices":{"bufferView":2,"componentType":5121},"values":{"bufferView":0}},"min":[0,0,0]"#), &bin)),
    ]
}
