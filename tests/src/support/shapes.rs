//! Generated models, as OBJ, MTL and PNG files.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// A closed, bumpy ball with a nose. `2 × columns × (rings − 1)` faces.
pub(crate) fn ball(rings: usize, columns: usize) -> String {
    let point = |theta: f64, phi: f64| {
        let bumps = 0.12 * (5.0 * phi).sin() * (4.0 * theta).sin() + 0.03 * (17.0 * phi + 11.0 * theta).sin();
        let nose = 0.5 * (-20.0 * ((theta - 1.4).powi(2) + (phi - 1.2).powi(2))).exp();
        let r = 1.0 + theta.sin() * bumps + nose;
        [r * theta.sin() * phi.cos(), r * theta.cos(), r * theta.sin() * phi.sin()]
    };
    let mut obj = String::from("v 0 1 0\nv 0 -1 0\n");
    for ring in 1..rings {
        for column in 0..columns {
            let theta = std::f64::consts::PI * ring as f64 / rings as f64;
            let phi = std::f64::consts::TAU * column as f64 / columns as f64;
            let [x, y, z] = point(theta, phi);
            writeln!(obj, "v {x:.6} {y:.6} {z:.6}").unwrap();
        }
    }
    let at = |ring: usize, column: usize| 3 + (ring - 1) * columns + column % columns;
    for c in 0..columns {
        writeln!(obj, "f 1 {} {}", at(1, c + 1), at(1, c)).unwrap();
        writeln!(obj, "f 2 {} {}", at(rings - 1, c), at(rings - 1, c + 1)).unwrap();
        for ring in 1..rings - 1 {
            let corners = [at(ring, c), at(ring, c + 1), at(ring + 1, c + 1), at(ring + 1, c)];
            let [a, b, c, d] = corners;
            writeln!(obj, "f {a} {b} {c} {d}").unwrap();
        }
    }
    obj
}

/// Hilly ground of `2 × cells²` faces, four units to each side.
pub(crate) fn ground(cells: usize) -> String {
    let mut obj = String::new();
    let at = |i: usize| 8.0 * i as f64 / cells as f64 - 4.0;
    for (i, j) in (0..=cells).flat_map(|i| (0..=cells).map(move |j| (i, j))) {
        let (x, z) = (at(i), at(j));
        let y = -1.1 + 0.1 * (1.9 * x).sin() * (1.3 * z + 0.4).cos() + 0.02 * (7.0 * x + 5.0 * z).sin();
        writeln!(obj, "v {x:.5} {y:.5} {z:.5}").unwrap();
    }
    let number = |i: usize, j: usize| 1 + i * (cells + 1) + j;
    for (i, j) in (0..cells).flat_map(|i| (0..cells).map(move |j| (i, j))) {
        let corners = (number(i, j), number(i, j + 1), number(i + 1, j + 1), number(i + 1, j));
        writeln!(obj, "f {} {} {} {}", corners.0, corners.1, corners.2, corners.3).unwrap();
    }
    obj
}

/// Writes `wall.obj`: a box with hard edges, uv seams, a colour texture and a height map.
pub(crate) fn write_wall(folder: &Path) {
    let mut obj = String::from("mtllib wall.mtl\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n");
    for i in 0..8 {
        let side = |bit: usize, size: f64| if i >> bit & 1 == 1 { size } else { -size };
        writeln!(obj, "v {} {} {}", side(0, 1.2), side(1, 0.9), side(2, 0.2)).unwrap();
    }
    obj.push_str("usemtl brick\n");
    for [a, b, c, d] in [[5, 6, 8, 7], [2, 1, 3, 4], [6, 2, 4, 8], [1, 5, 7, 3], [7, 8, 4, 3], [1, 2, 6, 5]] {
        writeln!(obj, "f {a}/1 {b}/2 {c}/3 {d}/4").unwrap();
    }
    std::fs::write(folder.join("wall.obj"), obj).unwrap();
    let mtl = "newmtl brick\nKd 1 1 1\nNs 20\nmap_Kd brick.png\ndisp brick_height.png\n";
    std::fs::write(folder.join("wall.mtl"), mtl).unwrap();
    let joint = |x: u32, y: u32| {
        let (row, along) = (y / 16, (x + 16 * (y / 16 % 2)) % 32);
        (y % 16 < 2 || along < 2, row * 7 + x / 32 * 3)
    };
    let colour = image::RgbImage::from_fn(128, 128, |x, y| match joint(x, y) {
        (true, _) => image::Rgb([150, 146, 138]),
        (false, brick) => image::Rgb([150 + (brick * 11 % 40) as u8, 92 - (brick * 5 % 20) as u8, 70]),
    });
    colour.save(folder.join("brick.png")).unwrap();
    let height =
        image::GrayImage::from_fn(128, 128, |x, y| image::Luma([if joint(x, y).0 { 0 } else { 255 }]));
    height.save(folder.join("brick_height.png")).unwrap();
}

/// The scene of most tests: a ball before a brick wall, a smaller instance behind it, on hilly ground, and a ball so
/// far away that only its coarse levels are needed; about 19,000 distinct faces.
pub(crate) fn write_scene(folder: &Path) -> std::path::PathBuf {
    std::fs::write(folder.join("ball.obj"), ball(60, 100)).unwrap();
    std::fs::write(folder.join("moon.obj"), ball(40, 60)).unwrap();
    std::fs::write(folder.join("ground.obj"), ground(36)).unwrap();
    write_wall(folder);
    let text = r#"name = "small"

[light]
direction = [0.5, 0.7, 0.5]
color = [0.6, 0.58, 0.52]

[ambient]
color = [0.08, 0.08, 0.08]

[camera]
eye = [0.3, 0.6, 4.2]
target = [0.0, -0.1, 0.0]
fov_y_degrees = 42.0

[[asset]]
name = "ball"
file = "ball.obj"
position_bits = 13

[[asset]]
name = "moon"
file = "moon.obj"
position_bits = 13

[[asset]]
name = "wall"
file = "wall.obj"
relief_depth = 0.02

[[asset]]
name = "ground"
file = "ground.obj"

[[instance]]
asset = "ball"
translation = [-0.6, 0.0, 0.4]

[[instance]]
asset = "ball"
translation = [2.4, -0.4, -1.8]
scale = 0.6

[[instance]]
asset = "moon"
translation = [-14.0, 5.5, -40.0]

[[instance]]
asset = "wall"
translation = [1.2, -0.1, -0.4]
rotation = [0.0, -0.1736482, 0.0, 0.9848078]

[[instance]]
asset = "ground"
"#;
    let path = folder.join("scene.toml");
    std::fs::write(&path, text).unwrap();
    path
}

/// A plate with a normal map and maps of roughness and metal, of 300 texels a side: whole levels and tiles of
/// planes. Gives the scene file.
pub(crate) fn write_plate(folder: &Path) -> PathBuf {
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    write(
        "plate.obj",
        "mtllib plate.mtl\nusemtl plate\nv -2 -1.2 0\nv 2 -1.2 0\nv 2 1.2 0\nv -2 1.2 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 \
         1\nf 1/1 2/2 3/3 4/4\n",
    );
    write("plate.mtl", "newmtl plate\nKd 0.7 0.6 0.5\nPr 1\nPm 1\nnorm n.png\nmap_Pr r.png\nmap_Pm m.png\n");
    let wave = |at: u32, length: f64| (f64::from(at) / length).sin();
    let byte = |value: f64| (127.5 + 127.5 * value) as u8;
    let save = |name: &str, texel: &dyn Fn(u32, u32) -> [u8; 3]| {
        let image = image::RgbImage::from_fn(300, 300, |x, y| image::Rgb(texel(x, y)));
        image.save(folder.join(name)).unwrap();
    };
    save("n.png", &|x, y| {
        let (a, b) = (0.6 * wave(x + y / 7, 9.0), 0.6 * wave(y + x / 5, 13.0));
        [byte(a), byte(b), byte((1.0 - a * a - b * b).sqrt())]
    });
    save("r.png", &|x, y| [byte(wave(x, 17.0) * wave(y + x / 9, 21.0)); 3]);
    save("m.png", &|x, y| [byte(wave(x + y, 31.0)); 3]);
    let scene = "name = \"plate\"\n[light]\ndirection = [0.4, 0.5, 0.8]\n[camera]\neye = [0.0, 0.0, 3.0]\ntarget = \
                 [0.0, 0.0, 0.0]\nfov_y_degrees = 42.0\n[[asset]]\nname = \"plate\"\nfile = \
                 \"plate.obj\"\n[[instance]]\nasset = \"plate\"\n";
    write("scene.toml", scene);
    folder.join("scene.toml")
}
