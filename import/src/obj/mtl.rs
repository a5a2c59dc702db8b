//! MTL files to [`Material`]s.
//!
//! `tobj` reads the values; the pass before it drops lines that it would fail or panic on, with a
//! warning. Texture options (`-bm`, `-s`, …) are split from the file names here.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Component, Path, PathBuf};

use crate::model::Material;
use crate::srgb::srgb_to_linear;

/// Largest MTL file, in bytes.
const MAX_MTL_BYTES: u64 = 64 << 20;
/// Warnings are for people: past this many per file, only their number is told.
const MAX_WARNINGS: usize = 20;

/// Materials by name; of two with the same name the later counts, as in `tobj`.
pub(super) type Library = BTreeMap<String, Material>;

/// Reads one MTL file of a model in folder `root` into `library`. What cannot be used becomes a warning.
pub(super) fn load(root: &Path, path: &Path, library: &mut Library, warnings: &mut Vec<String>) {
    match crate::file::read_file(path, MAX_MTL_BYTES) {
        Ok(bytes) => parse(root, path, &bytes, library, warnings),
        Err(error) => warnings.push(format!("{error}; faces that use its materials become grey")),
    }
}

fn parse(root: &Path, path: &Path, bytes: &[u8], library: &mut Library, warnings: &mut Vec<String>) {
    let mut found = Vec::new();
    let text = sanitise(&String::from_utf8_lossy(bytes), &mut found);
    let left_out = found.len().saturating_sub(MAX_WARNINGS);
    found.truncate(MAX_WARNINGS);
    warnings.extend(found.into_iter().map(|(line, what)| format!("{}:{line}: {what}", path.display())));
    if left_out > 0 {
        warnings.push(format!("{}: {left_out} more lines were ignored", path.display()));
    }
    match tobj::load_mtl_buf(&mut text.as_bytes()) {
        Ok((materials, _)) => {
            let folder = path.parent().unwrap_or(Path::new(""));
            for material in materials {
                let mut locate = |name: &str| {
                    let found = locate(root, folder, name);
                    found.map_err(|why| warnings.push(format!("{}: {why}", path.display()))).ok()
                };
                library.insert(material.name.clone(), convert(&material, &mut locate));
            }
        }
        Err(error) => warnings.push(format!("{}: {error}; its materials are not used", path.display())),
    }
}

/// The lines that are used, in the form that `tobj` 4 reads without failing: no leading blanks, one
/// space after the keyword, colours with three values.
fn sanitise(text: &str, warnings: &mut Vec<(usize, String)>) -> String {
    let mut out = String::with_capacity(text.len());
    let mut named = false;
    for (number, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.trim();
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        let lower = keyword.to_ascii_lowercase();
        if !matches!(
            lower.as_str(),
            "newmtl" | "kd" | "ns" | "d" | "tr" | "map_kd" | "map_bump" | "bump" | "disp"
        ) {
            continue;
        }
        let mut ignore = |why: &str| warnings.push((number + 1, format!("{why}; the line is ignored")));
        if rest.is_empty() {
            ignore(&format!("{keyword} without a value"));
            continue;
        }
        if lower == "newmtl" {
            named = true;
        } else if !named {
            ignore(&format!("{keyword} before the first newmtl"));
            continue;
        }
        let values =
            || rest.split_whitespace().map_while(|word| word.parse::<f64>().ok().filter(|x| x.is_finite()));
        let line = match lower.as_str() {
            "newmtl" => format!("newmtl {rest}"),
            "kd" => match values().collect::<Vec<_>>()[..] {
                [r, g, b, ..] => format!("Kd {r:?} {g:?} {b:?}"),
                [grey] => format!("Kd {grey:?} {grey:?} {grey:?}"),
                _ => {
                    ignore("Kd needs one or three numbers (spectral and xyz colours are not read)");
                    continue;
                }
            },
            "ns" | "d" | "tr" => {
                // "d -halo x" is an option of an effect that is not drawn: the value still counts.
                let value = rest.trim_start_matches("-halo").split_whitespace().next();
                let Some(value) = value.and_then(|v| v.parse::<f64>().ok()).filter(|v| v.is_finite()) else {
                    ignore(&format!("{keyword} needs a number"));
                    continue;
                };
                match lower.as_str() {
                    "ns" => format!("Ns {value:?}"),
                    "d" => format!("d {value:?}"),
                    _ => format!("d {:?}", 1.0 - value),
                }
            }
            "map_kd" => format!("map_Kd {rest}"),
            "disp" => format!("disp {rest}"),
            _ => format!("map_Bump {rest}"),
        };
        let _ = writeln!(out, "{line}");
    }
    out
}

/// `locate` says where a texture of some name is.
fn convert(material: &tobj::Material, locate: &mut dyn FnMut(&str) -> Option<PathBuf>) -> Material {
    let default = Material::default();
    let color = material.diffuse_texture.as_deref().map(texture_options);
    // Displacement is the more exact word for a height map; a bump map is the common one.
    let height =
        material.unknown_param.get("disp").or(material.normal_texture.as_ref()).map(|t| texture_options(t));
    let base_color = match material.diffuse {
        // Some exporters write black beside a texture and mean the texture.
        Some([0.0, 0.0, 0.0]) if color.is_some() => [1.0; 3],
        Some(rgb) => rgb.map(|x| srgb_to_linear(x.clamp(0.0, 1.0) as f32)),
        // A texture alone is meant as it is.
        None if color.is_some() => [1.0; 3],
        None => default.base_color,
    };
    Material {
        name: material.name.clone(),
        base_color,
        opacity: material.dissolve.map_or(1.0, |d| d.clamp(0.0, 1.0) as f32),
        roughness: material.shininess.map_or(default.roughness, roughness),
        color_texture: color.and_then(|t| locate(&t.file)).map(Into::into),
        height_scale: height.as_ref().map_or(1.0, |t| t.bump),
        height_texture: height.and_then(|t| locate(&t.file)).map(Into::into),
    }
}

/// Perceptual roughness of a Phong exponent: α² = 2 / (n + 2) (Walter et al., "Microfacet models for
/// refraction", 2007, §5.2) with α = roughness² (Burley 2012). Square roots only, so that every
/// machine gets the same bits.
fn roughness(exponent: f64) -> f32 {
    (2.0 / (exponent.max(0.0) + 2.0)).sqrt().sqrt() as f32
}

struct TextureOptions {
    file: String,
    bump: f32,
}

/// Splits `-option value … file name with blanks`.
fn texture_options(text: &str) -> TextureOptions {
    let mut bump = 1.0;
    let mut rest = text.trim();
    while rest.starts_with('-') {
        let (option, tail) = split_word(rest);
        // How many values an option takes, and whether they all must be there.
        let (count, optional) = match option {
            "-blendu" | "-blendv" | "-cc" | "-clamp" | "-bm" | "-boost" | "-imfchan" | "-texres"
            | "-type" => (1, false),
            "-mm" => (2, false),
            "-o" | "-s" | "-t" => (3, true),
            _ => break,
        };
        rest = tail;
        for _ in 0..count {
            let (value, tail) = split_word(rest);
            if tail.is_empty() || (optional && value.parse::<f64>().is_err()) {
                break;
            }
            if option == "-bm" {
                bump = value.parse::<f32>().ok().filter(|b| b.is_finite()).unwrap_or(1.0);
            }
            rest = tail;
        }
    }
    TextureOptions { file: rest.to_owned(), bump }
}

fn split_word(text: &str) -> (&str, &str) {
    let (word, tail) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    (word, tail.trim_start())
}

/// The file that is named in `folder`, within `root`, the model's folder; backslashes count as separators where the name
/// as written does not exist (files written on Windows).
///
/// # Errors
/// In one line: names that lead out of the model's folder. Whoever prepares a stranger's model would publish files of
/// his own otherwise.
pub(super) fn locate(root: &Path, folder: &Path, name: &str) -> Result<PathBuf, String> {
    let name = name.trim().trim_matches('"');
    let inside = |name: &str| {
        let below = folder.strip_prefix(root).unwrap_or(Path::new(""));
        let depth = below.components().chain(Path::new(name).components()).try_fold(
            0_usize,
            |depth, part| match part {
                Component::Normal(_) => Some(depth + 1),
                Component::CurDir => Some(depth),
                Component::ParentDir => depth.checked_sub(1),
                Component::RootDir | Component::Prefix(_) => None,
            },
        );
        depth.map(|_| folder.join(name)).ok_or_else(|| {
            format!("{name:?} is not in the model's folder or below it and is left out; put the file there")
        })
    };
    let path = inside(name)?;
    if !path.exists() && name.contains('\\') {
        return inside(&name.replace('\\', "/"));
    }
    Ok(path)
}

#[cfg(test)]
mod tests {
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
}
