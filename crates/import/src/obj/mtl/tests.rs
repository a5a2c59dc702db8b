//! Statements, unusual files and invalid ones.

use std::path::PathBuf;

use super::*;

fn read(text: &str) -> (Library, Vec<String>) {
    let (mut library, mut warnings) = (Library::new(), Vec::new());
    parse(
        &Beside::new(Path::new("dir/a.obj")),
        Path::new("dir/m.mtl"),
        text.as_bytes(),
        &mut library,
        &mut warnings,
    );
    (library, warnings)
}

fn height_image(material: &ImportedMaterial) -> Option<&ImageSource> {
    material.maps.height.as_ref().map(|height| &height.image)
}

#[test]
fn values_textures_and_options_are_read() {
    let (library, warnings) = read(
        "# comment\nnewmtl brick wall\n\tKd 0.5 0.25 2\nNs 0\nd 0.5\n\
         map_Kd -s 2 2 1 -clamp on my bricks.png\nbump -bm 0.25 bricks height.png\n",
    );
    assert!(warnings.is_empty(), "{warnings:?}");
    let brick = &library["brick wall"];
    let ImportedMaterial { material, maps, .. } = brick;
    let [r, g, b] = [0.5, 0.25, 1.0].map(srgb_to_linear);
    assert_eq!((material.base_color, material.roughness), ([r, g, b, 0.5], 1.0));
    assert_eq!(maps.color, Some(PathBuf::from("dir/my bricks.png").into()));
    let height = HeightMap { image: PathBuf::from("dir/bricks height.png").into(), scale: 0.25 };
    assert_eq!(maps.height, Some(height));
}

#[test]
fn disp_is_preferred_to_bump() {
    let (library, _) = read("newmtl a\nmap_Bump b.png\ndisp -mm 0 1 d.png\n");
    assert_eq!(height_image(&library["a"]), Some(&PathBuf::from("dir/d.png").into()));
}

#[test]
fn a_colour_of_one_value_which_panics_in_the_parser_is_grey() {
    let (library, warnings) = read("newmtl a\nKd 0.5\n");
    assert_eq!(library["a"].material.base_color[..3], [srgb_to_linear(0.5); 3]);
    assert!(warnings.is_empty());
}

#[test]
fn bad_lines_are_warned_of_and_the_rest_is_used() {
    let (library, warnings) = read("Kd 1 0 0\nnewmtl a\nKd spectral x.rfl\nNs abc\nmap_Kd\nd nan\nd 0.25\n");
    assert_eq!(library["a"].material.base_color[3], 0.25);
    assert_eq!(warnings.len(), 5, "{warnings:?}");
    assert!(warnings[0].contains("dir/m.mtl:1: Kd before the first newmtl"));
    assert!(warnings[2].contains(":4: Ns needs a number"));
}

#[test]
fn random_bytes_give_no_material_and_no_panic() {
    let noise: Vec<u8> = (0..20_000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let (mut library, mut warnings) = (Library::new(), Vec::new());
    parse(&Beside::new(Path::new("a.obj")), Path::new("x.mtl"), &noise, &mut library, &mut warnings);
    assert!(library.is_empty());
    assert!(warnings.len() <= MAX_WARNINGS + 1);
}

#[test]
fn every_statement_has_its_place() {
    let (library, warnings) = read(
        "newmtl a\nKd 1 1 1\nKe 0.5 1 4\nPr 0.25\nPm 0.75\nNs 10\nTr 0.25\nillum 0\n\
         map_Kd -clamp on c.png\nmap_Ke e.png\nmap_Pr -imfchan g s.png\nmap_Pm m.png\nnorm -bm 0.5 n.png\n\
         map_d d.png\ndisp h.png\n",
    );
    assert!(warnings.is_empty(), "{warnings:?}");
    let ImportedMaterial { material: a, maps, alpha_from_map } = &library["a"];
    let image = |name: &str| ImageSource::from(PathBuf::from("dir").join(name));
    assert_eq!(a.emission, [srgb_to_linear(0.5), 1.0, 4.0]);
    assert_eq!((a.roughness, a.metallic, a.base_color[3]), (0.25, 0.75, 0.75));
    assert_eq!((a.unlit, a.alpha, *alpha_from_map), (true, Alpha::Blend, false));
    assert_eq!(a.wrap, [lodestream_scene::asset::Wrap::Clamp; 2]);
    assert_eq!((&maps.color, &maps.emission), (&Some(image("c.png")), &Some(image("e.png"))));
    assert_eq!(maps.surface.roughness, Some(Channel::plain(image("s.png"), Component::Green)));
    assert_eq!(maps.surface.metallic, Some(Channel::plain(image("m.png"), Component::Luminance)));
    assert_eq!((&maps.normal, a.normal_scale), (&Some(image("n.png")), 0.5));
    assert_eq!(maps.opacity, Some(Channel::plain(image("d.png"), Component::Mask)));
    assert_eq!(height_image(&library["a"]), Some(&image("h.png")));
    assert_eq!(maps.images().count(), 7);
}

#[test]
fn maps_without_factors_count_as_they_are() {
    let (library, warnings) = read(
        "newmtl a\nKe 0 0 0\nPm 0\nmap_Ke e.png\nmap_Pr r.png\nmap_Pm m.png\nmap_Kd c.png\nmap_d c.png\n",
    );
    assert!(warnings.is_empty(), "{warnings:?}");
    let ImportedMaterial { material: a, maps, alpha_from_map } = &library["a"];
    assert_eq!((a.emission, a.roughness, a.metallic), ([1.0; 3], 1.0, 1.0));
    assert!(alpha_from_map);
    // The opacity map is the colour map's file, so its alpha channel is used, not its luminance.
    assert_eq!(maps.opacity.as_ref().map(|o| o.component), Some(Component::Alpha));
    let (library, _) = read("newmtl b\n");
    let ImportedMaterial { material: b, alpha_from_map, .. } = &library["b"];
    assert_eq!((b.emission, b.metallic, b.alpha, *alpha_from_map), ([0.0; 3], 0.0, Alpha::Opaque, false));
}

#[test]
fn invisible_materials_are_drawn_opaque_and_d_overrides_tr() {
    let (library, warnings) =
        read("newmtl a\nd 0\nnewmtl b\nd 0.5\nTr 0.75\nnewmtl c\nTr 0.75\nnewmtl d\nd 0\nmap_d m.png\n");
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].contains("\"a\" would be invisible"), "{warnings:?}");
    let of = |name: &str| {
        let ImportedMaterial { material, alpha_from_map, .. } = &library[name];
        (material.base_color[3], material.alpha, *alpha_from_map)
    };
    assert_eq!(of("a"), (1.0, Alpha::Opaque, false));
    assert_eq!(of("b"), (0.5, Alpha::Blend, false));
    assert_eq!(of("c"), (0.25, Alpha::Blend, false));
    assert_eq!(of("d"), (1.0, Alpha::Opaque, true));
}

#[test]
fn odd_values_are_brought_into_range_or_warned_of() {
    let (library, warnings) = read(
        "newmtl a\nPr 7\nPm -1\nKe -1 1e30 nan\nKe -1 1e30 2\nillum 11\nillum x\nnorm -bm -2 n.png\nPr inf\nmap_Pr\n",
    );
    let ImportedMaterial { material: a, maps, .. } = &library["a"];
    assert_eq!((a.roughness, a.metallic, a.emission), (1.0, 0.0, [0.0, MAX_EMISSION, 2.0]));
    assert_eq!((a.unlit, &maps.normal), (false, &None));
    for part in [":4: Ke", ":6: illum", ":7: illum", "factor below zero", ":9: Pr", ":10: map_Pr"] {
        assert!(warnings.iter().any(|w| w.contains(part)), "{warnings:?} lack {part:?}");
    }
    let (library, _) = read("newmtl a\nnorm -bm 1e9 n.png\n");
    assert_eq!(library["a"].material.normal_scale, MAX_NORMAL_SCALE);
}
