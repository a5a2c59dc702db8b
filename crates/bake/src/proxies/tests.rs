//! Proxies of generated scenes.

use std::fmt::Write as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use glam::DVec3;
use lodestream_geometry::distance::TriangleBvh;
use lodestream_geometry::mesh::{NONE, QuantisedMesh};
use lodestream_geometry::refine::ActiveMesh;
use lodestream_scene::BlobPart;
use lodestream_scene::description::ScenePage;
use lodestream_scene::proxy::Proxies;
use lodestream_store::SceneDescription;
use tempfile::TempDir;

use crate::compose::describe;
use crate::prepare::prepare_all;
use crate::scene;
use crate::scene::batch_tests::{Glb, sheet};

use super::*;

/// Rough ground of 200 faces on 10 × 10 units with a colour at each vertex, by a hash of `seed` and the place.
fn rough(seed: u32) -> String {
    let mut text = format!("mtllib {seed}.mtl\nusemtl m\ns 1\n");
    for i in 0..11 * 11_u32 {
        let hash = (i + 1000 * seed).wrapping_mul(0x9E37_79B9);
        let hash = (hash ^ (hash >> 15)).wrapping_mul(0x85EB_CA6B);
        let [height, red, green, blue] = hash.to_be_bytes().map(|byte| f64::from(byte) / 255.0);
        let _ = writeln!(text, "v {} {} {} {red} {green} {blue}", i % 11, 5.0 * height, i / 11);
    }
    for i in (0..10 * 10_u32).map(|i| i / 10 * 11 + i % 10 + 1) {
        let _ = writeln!(text, "f {i} {} {}\nf {i} {} {}", i + 11, i + 12, i + 12, i + 1);
    }
    text
}

/// A scene file with `assets` grounds, each placed twice: turned, and enlarged.
fn write(folder: &Path, assets: u32, more: &str) -> PathBuf {
    let mut text = format!("{more}\n[camera]\neye = [0.0, 50.0, -50.0]\ntarget = [60.0, 0.0, 60.0]\n");
    for seed in 0..assets {
        std::fs::write(folder.join(format!("{seed}.obj")), rough(seed)).unwrap();
        std::fs::write(folder.join(format!("{seed}.mtl")), "newmtl m\nKd 0.5 0.5 0.5\n").unwrap();
        let _ = write!(text, "[[asset]]\nname = \"{seed}\"\nfile = \"{seed}.obj\"\n");
        for copy in 0..2 {
            let number = 2 * seed + copy;
            let _ = write!(
                text,
                "[[instance]]\nasset = \"{seed}\"\ntranslation = [{}, {copy}, {}]\nscale = 1.{copy}\n\
                 rotation = {{ yaw = {} }}\n",
                number % 10 * 20,
                number / 10 * 20,
                7 * number
            );
        }
    }
    let path = folder.join("scene.toml");
    std::fs::write(&path, text).unwrap();
    path
}

fn options(threads: usize) -> Options {
    Options { quiet: true, threads: NonZeroUsize::new(threads), ..Options::default() }
}

fn prepared(file: &Path, cache: &Path) -> (Scene, Vec<PackFile>) {
    let scene = scene::of_files(&[file.to_owned()]).unwrap();
    let cached = prepare_all(&scene.assets, cache, &options(2), |_, _| {}).unwrap();
    (scene, cached.into_iter().map(|cached| cached.pack).collect())
}

/// A mesh with all chunks.
fn finest(pack: &PackFile) -> QuantisedMesh {
    let asset = pack.load().unwrap();
    let mut mesh = ActiveMesh::new(&asset.base);
    for ((chunk, info), payload) in (0..).zip(&asset.infos).zip(&asset.chunks) {
        mesh.apply(&mesh.decode(chunk, info, payload).unwrap()).unwrap();
    }
    mesh.to_mesh()
}

fn positions(mesh: &QuantisedMesh) -> Vec<[f64; 3]> {
    mesh.positions.iter().map(|&q| mesh.grid.position(q)).collect()
}

fn triangles(mesh: &QuantisedMesh) -> Vec<[u32; 3]> {
    mesh.faces.iter().map(|face| face.wedges.map(|wedge| mesh.wedges[wedge as usize].vertex)).collect()
}

/// Distances to a mesh.
fn surface(mesh: &QuantisedMesh) -> TriangleBvh {
    TriangleBvh::new(&positions(mesh), &triangles(mesh))
}

/// The proxies of a description as a client takes them, and its instances.
fn received(description: &SceneDescription) -> (Proxies, Vec<Instance>) {
    let mut proxies = Proxies::default();
    let mut assets = 0;
    for page in &description.pages {
        let ScenePage { first_proxy, first_asset, .. } = *page;
        assert_eq!(first_asset, assets);
        assets += page.assets.len() as u32;
        proxies.add(first_proxy, &page.proxies, assets, description.header.instance_count).unwrap();
    }
    assert_eq!(assets, description.header.asset_count);
    (proxies, description.pages.iter().flat_map(|page| page.instances.clone()).collect())
}

#[test]
fn each_level_stands_for_each_instance_once_and_errors_hold() {
    let dir = TempDir::new().unwrap();
    let (scene, packs) = prepared(&write(dir.path(), 160, ""), dir.path());
    let full: Vec<QuantisedMesh> = packs.iter().map(finest).collect();
    let forest = make(&scene, &packs, dir.path(), &options(2)).unwrap().unwrap();
    let text = forest.to_string();
    assert!(forest.prepared == forest.packs.len() && text.contains("bytes of base meshes"), "{text}");
    let meshes: Vec<_> = forest.packs.iter().map(|pack| (finest(pack), pack.base().unwrap())).collect();
    let first_proxy = packs.len();
    let (description, in_order) = describe(&scene, packs, Some(forest)).unwrap();
    let (proxies, instances) = received(&description);
    assert!(proxies.len() > 9 && proxies.roots() == [0], "{}", proxies.len());
    assert_eq!(in_order.len(), description.header.asset_count as usize);
    assert_eq!(instances.len(), 320);
    let [first, second] = [0, 1].map(|page: usize| &description.pages[page]);
    assert!((2..=16).contains(&first.proxies.len()) && first.instances.is_empty(), "{first:?}");
    assert!(!second.instances.is_empty(), "what is near comes before the other proxies");
    let deepest = proxies.nodes().iter().map(|node| node.depth).max().unwrap();
    for depth in 0..=deepest {
        let level = proxies.nodes().iter().filter(|node| {
            assert_eq!(node.children.len(), node.proxy.child_count as usize);
            node.depth == depth || node.depth < depth && node.children.is_empty()
        });
        let mut covered: Vec<u32> = level.flat_map(|node| node.proxy.instances()).collect();
        covered.sort_unstable();
        assert!(covered.into_iter().eq(0..320), "level {depth}");
    }
    for node in proxies.nodes() {
        let (mesh, base) = &meshes[description.asset_order[node.proxy.asset as usize] - first_proxy];
        let to_proxy = surface(mesh);
        let error = f64::from(node.proxy.error);
        let mut largest = 0.0_f64;
        for number in node.proxy.instances() {
            let instance = &instances[number as usize];
            let member = &full[description.asset_order[instance.asset as usize]];
            for point in positions(member) {
                let placed = instance.placement.to_world(point.into()).to_array();
                let (distance, _) = to_proxy.nearest(placed, f64::INFINITY).unwrap();
                largest = largest.max(distance);
            }
        }
        assert!(largest <= error * 1.001, "{largest} but the proxy states {error}");
        // Far below would mean that nothing is gained: a client refines by the stated error.
        assert!(error < 60.0 * largest, "{error} {largest}");
        let is_root = node.proxy.parent().is_none();
        assert!(is_root || base.faces.len() < mesh.faces.len(), "{error} {largest}");
    }
}

/// What is near, the camera sees from above; what is farther may be hidden.
#[test]
fn roots_err_by_a_share_of_the_distance_from_the_start_camera() {
    let dir = TempDir::new().unwrap();
    let (scene, packs) = prepared(&write(dir.path(), 160, ""), dir.path());
    let forest = make(&scene, &packs, dir.path(), &options(2)).unwrap().unwrap();
    let slope = f64::from(forest.root_slope);
    let bytes = base_bytes(&forest.packs[0]);
    assert!(slope > 0.0 && slope < 0.1 && bytes <= start::MAX_BYTES, "{slope} {bytes}");
    let root = finest(&forest.packs[0]);
    let to_root = surface(&root);
    let camera = scene.camera.unwrap();
    let (eye, frustum) = (DVec3::from(camera.eye), camera.view([1280, 720], 1.0).frustum());
    let (proxy, mut faces) = (&forest.proxies[0], vec![0; forest.order.len()]);
    triangles(&root).iter().for_each(|corners| faces[root.parts[corners[0] as usize] as usize] += 1);
    // Faces and number of instances that are seen near by, and of those out of view.
    let (mut seen, mut unseen) = ([0, 0], [0, 0]);
    for number in proxy.instances() {
        let instance = &scene.instances.as_deref().unwrap()[forest.order[number as usize]];
        let points = positions(&finest(&packs[instance.asset as usize]));
        let points: Vec<DVec3> =
            points.iter().map(|&point| instance.placement.to_world(point.into())).collect();
        let is_in_view = points.iter().any(|point| frustum.sees((*point - eye).as_vec3(), 0.0));
        let is_near = points.iter().all(|point| point.distance(eye) < 120.0);
        if is_in_view && !is_near {
            continue;
        }
        let count = if is_in_view { &mut seen } else { &mut unseen };
        *count = [count[0] + faces[number as usize], count[1] + 1];
        for point in points.into_iter().filter(|_| is_in_view) {
            let (distance, _) = to_root.nearest(point.to_array(), f64::INFINITY).unwrap();
            // The source has half of the first error, and positions are rounded.
            assert!(distance <= 1.6 * slope * point.distance(eye), "{distance} at {point}");
        }
    }
    assert!(
        seen[1] > 4 && unseen[1] > 1 && seen[0] * unseen[1] > 2 * unseen[0] * seen[1],
        "{seen:?} {unseen:?}"
    );
}

fn base_bytes(pack: &PackFile) -> usize {
    pack.read(BlobPart::Base).unwrap().len()
}

#[test]
fn leaves_have_the_base_meshes_of_their_members_as_parts() {
    let dir = TempDir::new().unwrap();
    // One of the members has parts of its own.
    let mut glb = Glb::default();
    for number in 0..40 {
        let mesh = glb.mesh(&sheet(3, f64::from(number)));
        glb.node(mesh, [0.0, 0.0, 2.0 * f64::from(number)]);
    }
    glb.write(&dir.path().join("parts.glb"));
    let more = "[[asset]]\nname = \"parts\"\nfile = \"parts.glb\"\n[[instance]]\nasset = \"parts\"";
    let (scene, packs) = prepared(&write(dir.path(), 64, more), dir.path());
    let parts = |pack: &PackFile| pack.base().unwrap().parts.iter().max().copied();
    assert!(
        packs.iter().any(|pack| parts(pack) == Some(39)),
        "{:?}",
        packs.iter().map(parts).collect::<Vec<_>>()
    );
    let forest = make(&scene, &packs, dir.path(), &options(2)).unwrap().unwrap();
    let instances = scene.instances.as_deref().unwrap();
    let mut leaves = 0;
    for (proxy, pack) in forest.proxies.iter().zip(&forest.packs).filter(|(proxy, _)| proxy.child_count == 0)
    {
        leaves += 1;
        let mesh = finest(pack);
        let (points, corners) = (positions(&mesh), triangles(&mesh));
        let mut faces = 0;
        for (part, number) in proxy.instances().enumerate() {
            let instance = &instances[forest.order[number as usize]];
            let base = packs[instance.asset as usize].base().unwrap();
            let of_part = |corners: &&[u32; 3]| mesh.parts[corners[0] as usize] == part as u32;
            let own: Vec<_> = corners.iter().filter(of_part).copied().collect();
            assert_eq!(own.len(), base.faces.len());
            faces += own.len();
            let placed: Vec<DVec3> = base
                .positions
                .iter()
                .map(|&q| instance.placement.to_world(base.grid.position(q).into()))
                .collect();
            for vertex in own.into_iter().flatten() {
                let near = |point: &DVec3| point.distance(points[vertex as usize].into());
                let distance = placed.iter().map(near).fold(f64::MAX, f64::min);
                assert!(distance <= mesh.grid.step * 0.87, "{distance}, grid {}", mesh.grid.step);
            }
        }
        assert_eq!(faces, mesh.faces.len());
    }
    assert!(leaves > 2);
}

#[test]
fn threads_do_not_change_proxies_and_a_changed_member_only_its_ancestors() {
    let dir = TempDir::new().unwrap();
    let file = write(dir.path(), 160, "");
    let make_in = |cache: &str, threads| {
        let (scene, packs) = prepared(&file, dir.path());
        make(&scene, &packs, &dir.path().join(cache), &options(threads)).unwrap().unwrap()
    };
    let (one, three) = (make_in("one", 1), make_in("three", 3));
    let bytes = |forest: &Forest| -> Vec<_> {
        forest.packs.iter().map(|pack| std::fs::read(pack.path()).unwrap()).collect()
    };
    assert_eq!(bytes(&one), bytes(&three));
    assert!((&one.proxies, &one.order) == (&three.proxies, &three.order));
    let again = make_in("three", 2);
    assert!(again.prepared == 0 && again.proxies == one.proxies);
    // A damaged pack is made again.
    let damaged = again.packs[1].path().to_owned();
    std::fs::write(&damaged, &bytes(&again)[1][..400]).unwrap();
    let again = make_in("three", 2);
    assert_eq!((again.prepared, bytes(&again) == bytes(&one)), (1, true));
    // Another colour of equal length, in the two instances of one asset.
    std::fs::write(dir.path().join("0.mtl"), "newmtl m\nKd 0.5 0.5 0.4\n").unwrap();
    let changed = make_in("three", 2);
    assert_eq!((&changed.order, changed.packs.len()), (&one.order, one.packs.len()));
    let affected = |proxy: &&Proxy| proxy.instances().any(|number| changed.order[number as usize] < 2);
    let ancestors = changed.proxies.iter().filter(affected).count();
    assert!(ancestors < changed.packs.len() / 2, "{ancestors}");
    assert_eq!(changed.prepared, ancestors);
}

#[test]
fn textures_and_materials_become_colors_of_vertices() {
    let dir = TempDir::new().unwrap();
    let picture =
        image::RgbImage::from_fn(64, 64, |x, _| image::Rgb(if x < 32 { [255, 0, 0] } else { [0, 0, 255] }));
    picture.save(dir.path().join("t.png")).unwrap();
    // Left: red and blue halves of the texture. Right: a square without, and one that is transparent.
    let square = |x: f64, u: f64| {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let v = corners.iter().fold(String::new(), |text, [dx, y]| text + &format!("v {} {y} 0\n", x + dx));
        let vt =
            corners.iter().fold(String::new(), |text, [du, v]| text + &format!("vt {} {v}\n", u + du / 2.0));
        v + &vt
    };
    let mut text = String::from("mtllib m.mtl\n");
    for (i, (x, u, material)) in
        [(0.0, 0.0, "t"), (2.0, 0.5, "t"), (4.0, 0.0, "plain"), (6.0, 0.0, "glass")].into_iter().enumerate()
    {
        let [a, b, c, d] = [1, 2, 3, 4].map(|corner| 4 * i + corner);
        text += &square(x, u);
        let _ = write!(text, "usemtl {material}\nf {a}/{a} {b}/{b} {c}/{c}\nf {a}/{a} {c}/{c} {d}/{d}\n");
    }
    std::fs::write(dir.path().join("m.obj"), text).unwrap();
    let materials =
        "newmtl t\nKd 1 1 1\nmap_Kd t.png\nnewmtl plain\nKd 0 1 0\nnewmtl glass\nKd 1 1 1\nd 0.2\n";
    std::fs::write(dir.path().join("m.mtl"), materials).unwrap();
    let (_, packs) = prepared(&dir.path().join("m.obj"), dir.path());
    let half_turn = Placement { rotation: [0.0, 0.0, 1.0, 0.0], ..Placement::at([100.0, 0.0, 0.0]) };
    let member =
        Member { pack: &packs[0], number: 0, placement: half_turn, part: 3, is_instance: true, error: 0.0 };
    let NodeMesh { mesh, material, appearance_error } = union(&[member], false).unwrap();
    assert_eq!((mesh.faces.len(), &mesh.parts[..], material.base_color), (6, &[3; 6][..], [1.0; 4]));
    for corner in mesh.faces.iter().flatten() {
        let [x, _, _] = mesh.positions[corner.position as usize];
        let [r, g, b, a] = mesh.colors[corner.color as usize];
        let expected = match 100.0 - x {
            ..1.5 => r > 240 && g < 16 && b < 16,
            1.5..3.5 => r < 16 && g < 16 && b > 240,
            _ => [r, g, b] == [0, 255, 0],
        };
        assert!(expected && a == 255, "{:?} at {x}", [r, g, b]);
        // Flat squares need no normals.
        assert!(material.flat && corner.normal == NONE && mesh.normals.is_empty());
    }
    // The glass, and the texture's detail, are missing.
    assert!((1.0..3.0).contains(&appearance_error), "{appearance_error}");
    let member =
        Member { pack: &packs[0], number: 0, placement: half_turn, part: 0, is_instance: true, error: 0.0 };
    assert_eq!(union(&[member], true).unwrap().mesh.faces.len(), 8);
}

#[test]
fn scenes_with_few_bytes_or_one_instance_or_without_the_wish_have_none() {
    let dir = TempDir::new().unwrap();
    let file = write(dir.path(), 64, "");
    let (mut scene, packs) = prepared(&file, dir.path());
    let made = |scene: &Scene, options: &Options| make(scene, &packs, dir.path(), options).unwrap().is_some();
    let bytes: u32 = packs.iter().map(|pack| pack.entry("").unwrap().base_bytes).sum();
    assert!(made(&scene, &options(2)), "{bytes} bytes");
    let mut off = options(2);
    off.preparation_settings.proxies = Some(false);
    assert!(!made(&scene, &off));
    scene.proxies = false;
    assert!(!made(&scene, &options(2)));
    off.preparation_settings.proxies = Some(true);
    assert!(made(&scene, &off), "flags precede scene files");
    scene.proxies = true;
    let all = scene.instances.clone().unwrap();
    // Many, of few assets.
    scene.instances = Some(all.iter().map(|instance| Instance { asset: 0, ..*instance }).collect());
    assert!(!made(&scene, &options(2)));
    scene.instances = Some(all[..1].to_vec());
    assert!(!made(&scene, &options(2)));
    let hills = "[terrain]\nseed = 5\npatch_cells = 64\npatches = 4\namplitude = 1.0\n";
    let (with_terrain, packs) = prepared(&write(dir.path(), 64, hills), dir.path());
    assert!(make(&with_terrain, &packs, dir.path(), &options(2)).unwrap().is_some());
    let wish = scene::of_files(&[write(dir.path(), 1, "proxies = false")]).unwrap();
    assert!(!wish.proxies && scene::of_files(&[write(dir.path(), 1, "")]).unwrap().proxies);
}

#[test]
fn a_pack_that_cannot_be_read_is_an_error() {
    let dir = TempDir::new().unwrap();
    let (scene, packs) = prepared(&write(dir.path(), 64, ""), dir.path());
    let pack = packs[3].path();
    let mut bytes = std::fs::read(pack).unwrap();
    let base = packs[3].read(BlobPart::Base).unwrap();
    let at = bytes.windows(base.len()).position(|some| some == base).unwrap();
    bytes[at + 20] ^= 1;
    std::fs::write(pack, &bytes).unwrap();
    let why = make(&scene, &packs, dir.path(), &options(2)).unwrap_err().to_string();
    assert!(why.contains(&*pack.file_name().unwrap().to_string_lossy()), "{why}");
}
