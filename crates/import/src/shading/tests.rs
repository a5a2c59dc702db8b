use lodestream_geometry::mesh::{Corner, NONE};
use lodestream_geometry::normals::wedge_normals;
use lodestream_geometry::quantise::{QuantiseSettings, quantise};

use super::*;

/// A mesh of triangles over positions, without normals.
fn mesh(positions: &[[f64; 3]], faces: &[[u32; 3]]) -> SourceMesh {
    SourceMesh {
        positions: positions.to_vec(),
        faces: faces.iter().map(|face| face.map(Corner::at)).collect(),
        materials: vec![0; faces.len()],
        ..SourceMesh::default()
    }
}

/// A cube with eight corners.
fn cube() -> SourceMesh {
    let positions: Vec<_> = (0..8_u8).map(|i| [i >> 2, i >> 1 & 1, i & 1].map(f64::from)).collect();
    let sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let faces: Vec<_> = sides.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    mesh(&positions, &faces)
}

/// A cylinder without its ends: `sides` faces of two triangles.
fn tube(sides: u32) -> SourceMesh {
    let ring = |y: f64| {
        (0..sides).map(move |i| {
            let angle = f64::from(i) / f64::from(sides) * std::f64::consts::TAU;
            [angle.cos(), y, angle.sin()]
        })
    };
    let positions: Vec<_> = ring(0.0).chain(ring(1.0)).collect();
    let faces: Vec<_> = (0..sides)
        .flat_map(|i| {
            let j = (i + 1) % sides;
            [[i, i + sides, j], [j, i + sides, j + sides]]
        })
        .collect();
    mesh(&positions, &faces)
}

fn shaded(mut mesh: SourceMesh, shading: FaceShading, crease: f64) -> Imported {
    let shading = ShadingRuns::all(shading, mesh.faces.len());
    mesh.materials.resize(mesh.faces.len(), 0);
    let materials = vec![ImportedMaterial::named("a")];
    Unshaded { mesh, materials, shading, warnings: Vec::new() }.shade(crease.try_into().unwrap())
}

fn is_flat(imported: &Imported) -> Vec<bool> {
    imported.materials.iter().map(|material| material.material.flat).collect()
}

/// The largest angle in degrees between a face's normal and those that its corners are drawn with.
fn largest_bend(imported: &Imported) -> f64 {
    let mesh = quantise(&imported.mesh, &QuantiseSettings::default()).unwrap();
    let normals = wedge_normals(&mesh);
    let mut largest = 0.0_f64;
    for face in &mesh.faces {
        let [a, b, c] = face.wedges.map(|w| {
            let position = mesh.positions[mesh.wedges[w as usize].vertex as usize];
            glam::DVec3::from(mesh.grid.position(position))
        });
        let normal = (b - a).cross(c - a).normalize();
        for wedge in face.wedges {
            largest =
                largest.max(normal.dot(normals[wedge as usize].into()).clamp(-1.0, 1.0).acos().to_degrees());
        }
    }
    largest
}

fn explicit_and_wedges(imported: &Imported) -> (usize, usize) {
    let mesh = quantise(&imported.mesh, &QuantiseSettings::default()).unwrap();
    (mesh.wedges.iter().filter(|wedge| wedge.attributes.normal.is_some()).count(), mesh.wedges.len())
}

#[test]
fn a_box_is_flat_and_needs_no_normals() {
    for shading in [FaceShading::Flat, FaceShading::Creased] {
        let imported = shaded(cube(), shading, 40.0);
        assert_eq!(is_flat(&imported), [true], "{shading:?}");
        assert!(imported.mesh.normals.is_empty());
        assert_eq!(explicit_and_wedges(&imported), (0, 8));
    }
    let rounded = shaded(cube(), FaceShading::Group(1), 40.0);
    assert_eq!(is_flat(&rounded), [false]);
    assert!(largest_bend(&rounded) > 30.0);
    // Nothing is a crease.
    assert!(largest_bend(&shaded(cube(), FaceShading::Creased, 180.0)) > 30.0);
}

#[test]
fn a_faceted_tube_is_flat_where_the_file_says_so() {
    let imported = shaded(tube(12), FaceShading::Flat, 40.0);
    assert_eq!(is_flat(&imported), [true]);
    assert!(imported.mesh.normals.is_empty());
    // Without a word from the file it is round, and with another angle it is not.
    let round = shaded(tube(12), FaceShading::Creased, 40.0);
    assert_eq!((is_flat(&round), round.mesh.normals.len()), (vec![false], 0));
    assert_eq!(is_flat(&shaded(tube(12), FaceShading::Creased, 20.0)), [true]);
}

#[test]
fn a_finely_sampled_surface_stays_smooth() {
    // Neighbours at less than a degree and a half.
    let imported = shaded(tube(256), FaceShading::Flat, 40.0);
    assert_eq!((is_flat(&imported), imported.mesh.normals.len()), (vec![false], 0));
}

#[test]
fn smooth_surfaces_end_at_creases() {
    // A closed cylinder: round with sharp rims.
    let mut closed = tube(32);
    for (ring, y) in [(0, 0.0), (32, 1.0)] {
        let centre = closed.positions.len() as u32;
        closed.positions.push([0.0, y, 0.0]);
        for i in 0..32_u32 {
            let [a, b] = [i, (i + 1) % 32].map(|i| ring + i);
            let face = if ring == 0 { [centre, a, b] } else { [centre, b, a] };
            closed.faces.push(face.map(Corner::at));
        }
    }
    let imported = shaded(closed, FaceShading::Creased, 40.0);
    assert_eq!(is_flat(&imported), [false]);
    let bend = largest_bend(&imported);
    // Half of the angle between two of the 32 sides, and what area weights add.
    assert!((5.0..7.6).contains(&bend), "{bend}");
    // Normals follow from the faces: none is stored, and rims have two wedges each.
    assert_eq!(explicit_and_wedges(&imported), (0, 64 + 64 + 2));
}

#[test]
fn smoothing_groups_are_smooth_apart_from_each_other() {
    let fold = mesh(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], &[[0, 1, 2], [1, 0, 3]]);
    let with = |groups: [u32; 2]| {
        let mut shading = ShadingRuns::default();
        shading.push(1, FaceShading::Group(groups[0]));
        shading.push(2, FaceShading::Group(groups[1]));
        let materials = vec![ImportedMaterial::named("a")];
        let unshaded = Unshaded { mesh: fold.clone(), materials, shading, warnings: Vec::new() };
        largest_bend(&unshaded.shade(CreaseAngle::default()))
    };
    assert!(with([1, 1]) > 40.0);
    assert!(with([1, 2]) < 0.1);
}

#[test]
fn a_material_with_flat_and_other_faces_becomes_two() {
    // A box, and a round tube beside it that says nothing.
    let mut both = tube(12);
    let first = both.positions.len() as u32;
    let tubes = both.faces.len();
    both.positions.extend(cube().positions.iter().map(|[x, y, z]| [x + 5.0, *y, *z]));
    both.faces.extend(cube().faces.iter().map(|f| f.map(|c| Corner::at(c.position + first))));
    both.materials.resize(both.faces.len(), 0);
    let of = |shading: [FaceShading; 2]| {
        let mut runs = ShadingRuns::default();
        runs.push(tubes, shading[0]);
        runs.push(both.faces.len(), shading[1]);
        let materials = vec![ImportedMaterial::named("a")];
        let unshaded = Unshaded { mesh: both.clone(), materials, shading: runs, warnings: Vec::new() };
        unshaded.shade(CreaseAngle::default())
    };
    let split = of([FaceShading::Flat, FaceShading::Group(1)]);
    assert_eq!(is_flat(&split), [false, true]);
    assert!(split.mesh.materials[..tubes].iter().all(|material| *material == 1));
    assert!(split.mesh.materials[tubes..].iter().all(|material| *material == 0));
    assert_eq!(split.materials[0].material.name, split.materials[1].material.name);
    // Where flat and smooth look alike there is no need for a second one.
    let one = of([FaceShading::Creased, FaceShading::Flat]);
    assert_eq!((is_flat(&one), one.mesh.normals.len()), (vec![false], 24));
    assert_eq!(is_flat(&of([FaceShading::Flat, FaceShading::Flat])), [true]);
}

#[test]
fn faces_with_normals_keep_them() {
    let mut given = cube();
    given.normals = vec![[0.0, 1.0, 0.0]];
    given.faces.iter_mut().flatten().for_each(|corner| corner.normal = 0);
    let imported = shaded(given.clone(), FaceShading::Given, 40.0);
    assert_eq!((is_flat(&imported), &imported.mesh), (vec![false], &given));
    // One side without.
    given.faces[..2].iter_mut().flatten().for_each(|corner| corner.normal = NONE);
    let mut shading = ShadingRuns::default();
    shading.push(2, FaceShading::Flat);
    shading.push(12, FaceShading::Given);
    let materials = vec![ImportedMaterial::named("a")];
    let imported = Unshaded { mesh: given, materials, shading, warnings: Vec::new() };
    let imported = imported.shade(CreaseAngle::default());
    assert_eq!(is_flat(&imported), [false]);
    assert!(imported.mesh.faces[2..].iter().flatten().all(|corner| corner.normal == 0));
    for corner in imported.mesh.faces[..2].iter().flatten() {
        assert_eq!(imported.mesh.normals[corner.normal as usize], [-1.0, 0.0, 0.0]);
    }
}

#[test]
fn odd_surfaces_are_shaded_without_a_panic() {
    // Equal faces, faces back to back, faces without an area, and three at an edge.
    let positions = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [2.0, 0.0, 0.0]];
    let faces =
        [[0, 1, 2], [0, 1, 2], [2, 1, 0], [0, 0, 0], [0, 1, 4], [0, 1, 3], [1, 0, 3], [0, 1, 1], [3, 2, 1]];
    for shading in [FaceShading::Flat, FaceShading::Creased, FaceShading::Group(7)] {
        let imported = shaded(mesh(&positions, &faces), shading, 40.0);
        assert!(imported.mesh.normals.iter().flatten().all(|x| x.is_finite()));
        quantise(&imported.mesh, &QuantiseSettings::default()).unwrap();
    }
}

/// The cube as an OBJ file, with lines before its faces.
fn obj(before: &str) -> String {
    let mut text = String::new();
    for [x, y, z] in cube().positions {
        text += &format!("v {x} {y} {z}\n");
    }
    text += before;
    for face in cube().faces {
        let [a, b, c] = face.map(|corner| corner.position + 1);
        text += &format!("f {a} {b} {c}\n");
    }
    text
}

/// The cube as a glTF file, with normals along the diagonals or without.
fn gltf(normals: bool) -> String {
    let cube = cube();
    let mut bytes: Vec<u8> =
        cube.positions.iter().flatten().flat_map(|x| (*x as f32).to_le_bytes()).collect();
    let corners = cube.positions.iter().flatten().map(|x| (*x as f32 - 0.5) * 2.0 / 3_f32.sqrt());
    bytes.extend(corners.flat_map(f32::to_le_bytes));
    bytes.extend(cube.faces.iter().flatten().flat_map(|corner| (corner.position as u16).to_le_bytes()));
    let mut attributes = serde_json::json!({"POSITION": 0});
    if normals {
        attributes["NORMAL"] = 1.into();
    }
    let uri = format!("data:application/octet-stream;base64,{}", data_encoding::BASE64.encode(&bytes));
    let vectors = |view: u32| serde_json::json!({"bufferView": view, "componentType": 5126, "count": 8, "type": "VEC3"});
    serde_json::json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": bytes.len(), "uri": uri}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 96},
            {"buffer": 0, "byteOffset": 96, "byteLength": 96},
            {"buffer": 0, "byteOffset": 192, "byteLength": 72},
        ],
        "accessors": [
            vectors(0),
            vectors(1),
            {"bufferView": 2, "componentType": 5123, "count": 36, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 2}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    })
    .to_string()
}

#[test]
fn files_say_what_is_flat() {
    let dir = tempfile::TempDir::new().unwrap();
    let flat = |name: &str, text: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, text).unwrap();
        is_flat(&crate::import(&path).unwrap())
    };
    for (before, wanted) in [
        ("", true),
        ("s off\n", true),
        ("s 0\n", true),
        ("s 1\n", false),
        ("s on\n", false),
        ("s 1\ns off\n", true),
    ] {
        assert_eq!(flat("a.obj", &obj(before)), [wanted], "{before:?}");
    }
    // Normals come first.
    let text = obj("vn 0 1 0\ns off\n");
    let normals = text.lines().map(|line| match line.strip_prefix("f ") {
        Some(corners) => {
            format!("f {}\n", corners.split(' ').map(|c| format!("{c}//1 ")).collect::<String>())
        }
        None => format!("{line}\n"),
    });
    assert_eq!(flat("b.obj", &normals.collect::<String>()), [false]);
    assert_eq!(flat("a.gltf", &gltf(false)), [true]);
    assert_eq!(flat("b.gltf", &gltf(true)), [false]);
    let ply = |faces: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
             element face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n{faces}"
        )
    };
    assert_eq!(flat("a.ply", &ply("3 0 1 2\n3 1 0 3\n")), [true]);
    let facet =
        "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    assert_eq!(flat("a.stl", &format!("solid a\n{facet}endsolid a\n")), [true]);
}
