//! The memory of a tab stays under its setting while a camera flies through a scene that is larger.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use lodestream_bake::scene::of_files;

use super::devtools::Tab;
use super::page::{STATS, serve, settle};
use super::tab;
use crate::support::PICTURE_PX;
use crate::support::scene::{TestScene, prepare_all};

/// Megabytes for heaps and GPU memory, the least that a page takes.
const MEMORY_MB: u64 = 64;
/// A canvas whose render targets, at full size, would take more than their share of [`MEMORY_MB`].
const LARGE_PX: [u32; 2] = [1600, 1000];
/// Bytes that one task may upload after the first picture: 2 MiB, and at most one part more.
const MAX_UPLOAD_BYTES: f64 = 3e6;
/// Most bytes of the worker's meshes by their faces (measured: 121 to 157).
const MESH_BYTES_PER_FACE: f64 = 250.0;
/// Squares in a row, eight units apart.
const SQUARES: usize = 12;
/// Cells along a side: all squares have more faces than [`MEMORY_MB`] allows.
const CELLS: usize = 90;
/// Side of each square's own texture: all together have more texels than [`MEMORY_MB`] allows.
const TEXTURE_PX: u32 = 1024;

/// Bumpy ground with texture coordinates; `number` makes it unlike the others.
fn square(number: usize) -> String {
    let mut obj = String::from("mtllib squares.mtl\n");
    let at = |i: usize| i as f64 / CELLS as f64;
    for (i, j) in (0..=CELLS).flat_map(|i| (0..=CELLS).map(move |j| (i, j))) {
        let (u, v) = (at(i), at(j));
        let y = 0.2 * (9.0 * u + number as f64).sin() * (11.0 * v).cos() + 0.05 * (71.0 * u * v).sin();
        writeln!(obj, "v {:.4} {y:.4} {:.4}\nvt {u:.4} {v:.4}", 8.0 * u - 4.0, 8.0 * v - 4.0).unwrap();
    }
    writeln!(obj, "usemtl square{number}").unwrap();
    let corner = |i: usize, j: usize| 1 + i * (CELLS + 1) + j;
    for (i, j) in (0..CELLS).flat_map(|i| (0..CELLS).map(move |j| (i, j))) {
        let [a, b, c, d] = [corner(i, j), corner(i, j + 1), corner(i + 1, j + 1), corner(i + 1, j)];
        writeln!(obj, "f {a}/{a} {b}/{b} {c}/{c} {d}/{d}").unwrap();
    }
    obj
}

fn write_row(folder: &Path) -> PathBuf {
    let (mut mtl, mut text) = (String::new(), String::from("name = \"row\"\n"));
    text.push_str("[camera]\neye = [-6.0, 3.0, 6.0]\ntarget = [0.0, 0.0, 0.0]\n");
    for number in 0..SQUARES {
        std::fs::write(folder.join(format!("square{number}.obj")), square(number)).unwrap();
        writeln!(mtl, "newmtl square{number}\nKd 1 1 1\nmap_Kd square{number}.png").unwrap();
        let picture = image::RgbImage::from_fn(TEXTURE_PX, TEXTURE_PX, |x, y| {
            image::Rgb([(x / 4) as u8, (y / 4) as u8, (20 * number as u32 + ((x * y) >> 12)) as u8])
        });
        picture.save(folder.join(format!("square{number}.png"))).unwrap();
        write!(text, "[[asset]]\nname = \"square{number}\"\nfile = \"square{number}.obj\"\n").unwrap();
        let x = 8 * number;
        write!(text, "[[instance]]\nasset = \"square{number}\"\ntranslation = [{x}.0, 0.0, 0.0]\n").unwrap();
    }
    std::fs::write(folder.join("squares.mtl"), mtl).unwrap();
    let path = folder.join("scene.toml");
    std::fs::write(&path, text).unwrap();
    path
}

/// Keeps the most memory at any time, not only where the view rests, as `window.most`.
fn watch(tab: &mut Tab) {
    tab.evaluate(
        "void setInterval(() => {
            const { heap_bytes: [worker, page], gpu_bytes } = lodestream.stats();
            window.most = Math.max(window.most ?? 0, worker + page + gpu_bytes);
        }, 20)",
    );
}

#[test]
fn memory_stays_under_its_setting_along_a_flight() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene = of_files(&[write_row(folder.path())]).unwrap();
    let scene = TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")));
    let server = serve(&scene);
    settle(&mut tab, &format!("{}#memory={MEMORY_MB}", server.page_url()));
    watch(&mut tab);
    let cap = (MEMORY_MB << 20) as f64;
    let [width, height] = PICTURE_PX.map(f64::from);
    for x in (0..8 * SQUARES).step_by(8) {
        let camera = format!("{x}, 1.6, 3, {x}, 0, -1, 0, 1, 0, 1");
        tab.evaluate(&format!(
            "void (lodestream.view.viewer.set_camera(performance.now(), Float64Array.of({camera})),
            lodestream.view.redraw())"
        ));
        // The worker has the new view before it is settled again.
        tab.evaluate("new Promise((done) => setTimeout(done, 300))");
        let stats = tab.wait("the view settles", STATS, |stats| stats["settled"] == true);
        let count = |name: &str| stats[name].as_f64().unwrap();
        println!("x = {x}: {stats}");
        assert!(4.0 * count("texels") <= cap / 4.0, "at {x}: {stats}");
        assert!(count("decode_failures") == 0.0, "{stats}");
        // Two pictures of the canvas, depth, normals, albedo and radiance are the least.
        assert!(count("target_bytes") >= width * height * 32.0, "{stats}");
        assert!(count("gpu_bytes") > count("target_bytes"), "{stats}");
        // Undone chunks leave nothing behind.
        assert!(count("mesh_bytes") <= MESH_BYTES_PER_FACE * count("faces"), "at {x}: {stats}");
        // All levels have four times the texels of the share, and what a view needs of their tiles fits.
        assert!(count("levels_without_room") == 0.0, "at {x}: {stats}");
        let most = tab.evaluate("window.most").as_f64().unwrap();
        println!("x = {x}: at most {most} bytes; longest task {} ms", stats["longest_task_ms"]);
        assert!(most <= cap, "at {x}: {most} bytes: {stats}");
        assert!(count("most_uploaded_bytes") <= MAX_UPLOAD_BYTES, "at {x}: {stats}");
    }
    server.assert_healthy();
}

/// The picture is drawn smaller, so that there is memory for what it shows.
#[test]
fn render_targets_of_a_large_canvas_leave_memory_for_meshes() {
    let Some(mut tab) = tab(LARGE_PX) else { return };
    let server = serve(TestScene::small());
    settle(&mut tab, &format!("{}#memory={MEMORY_MB}", server.page_url()));
    watch(&mut tab);
    // Another frame, of a moved camera.
    tab.evaluate("void (lodestream.view.viewer.turn(performance.now(), 40, 0), lodestream.view.redraw())");
    tab.evaluate("new Promise((done) => setTimeout(done, 300))");
    let stats = tab.wait("the view settles", STATS, |stats| stats["settled"] == true);
    let most = tab.evaluate("window.most").as_f64().unwrap();
    println!("at most {most} bytes: {stats}");
    let count = |name: &str| stats[name].as_f64().unwrap();
    let pixels = f64::from(LARGE_PX[0] * LARGE_PX[1]);
    assert!(count("target_bytes") >= 8.0 * pixels, "{stats}");
    assert!(
        count("target_bytes") <= 0.75 * (MEMORY_MB << 20) as f64 && most <= (MEMORY_MB << 20) as f64,
        "{stats}"
    );
    assert!(count("faces") > 0.0 && count("decode_failures") == 0.0, "{stats}");
    server.assert_healthy();
}
