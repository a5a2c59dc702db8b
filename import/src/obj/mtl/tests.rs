//! Statements, odd files and bad ones.

use std::path::PathBuf;

use super::*;

fn read(text: &str) -> (Library, Vec<String>) {
    let (mut library, mut warnings) = (Library::new(), Vec::new());
    parse(Path::new("dir"), Path::new("dir/m.mtl"), text.as_bytes(), &mut library, &mut warnings);
    (library, warnings)
}

#[test]
fn values_textures_and_options_are_read() {
    let (library, warnings) = read(
        "# comment\nnewmtl brick wall\n\tKd 0.5 0.25 2\nNs 0\nd 0.5\n\
         map_Kd -s 2 2 1 -clamp on my bricks.png\nbump -bm 0.25 bricks height.png\n",
    );
    assert!(warnings.is_empty(), "{warnings:?}");
    let brick = &library["brick wall"];
    assert_eq!(brick.base_color, [0.5, 0.25, 1.0].map(srgb_to_linear));
    assert_eq!(brick.roughness, 1.0);
    assert_eq!(brick.opacity, 0.5);
    assert_eq!(brick.color_texture, Some(PathBuf::from("dir/my bricks.png").into()));
    assert_eq!(brick.height_texture, Some(PathBuf::from("dir/bricks height.png").into()));
    assert_eq!(brick.height_scale, 0.25);
}

#[test]
fn disp_is_preferred_to_bump() {
    let (library, _) = read("newmtl a\nmap_Bump b.png\ndisp -mm 0 1 d.png\n");
    assert_eq!(library["a"].height_texture, Some(PathBuf::from("dir/d.png").into()));
}

#[test]
fn a_colour_of_one_value_which_panics_in_the_parser_is_grey() {
    let (library, warnings) = read("newmtl a\nKd 0.5\n");
    assert_eq!(library["a"].base_color, [srgb_to_linear(0.5); 3]);
    assert!(warnings.is_empty());
}

#[test]
fn bad_lines_are_warned_of_and_the_rest_is_used() {
    let (library, warnings) =
        read("Kd 1 0 0\nnewmtl a\nKd spectral x.rfl\nNs abc\nmap_Kd\nd nan\nd 0.25\n");
    assert_eq!(library["a"].opacity, 0.25);
    assert_eq!(warnings.len(), 5, "{warnings:?}");
    assert!(warnings[0].contains("dir/m.mtl:1: Kd before the first newmtl"));
    assert!(warnings[2].contains(":4: Ns needs a number"));
}

#[test]
fn random_bytes_give_no_material_and_no_panic() {
    let noise: Vec<u8> = (0..20_000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let (mut library, mut warnings) = (Library::new(), Vec::new());
    parse(Path::new(""), Path::new("x.mtl"), &noise, &mut library, &mut warnings);
    assert!(library.is_empty());
    assert!(warnings.len() <= MAX_WARNINGS + 1);
}
