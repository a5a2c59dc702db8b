//! The city's materials: factors and textures, as its GLB files state them.

use std::fmt::Write as _;

/// Index of a material; the same in each file of the city.
pub(super) type Material = usize;

/// A row of the table: name, linear base colour, roughness, metal, texture, and metres of a texture repeat.
type Row = (&'static str, [f64; 3], f64, f64, Option<&'static str>, f64);

const PLASTER: Option<&str> = Some("plaster.png");
const BRICK: Option<&str> = Some("facing-brick.png");
const ASHLAR: Option<&str> = Some("ashlar.png");
const TILES: Option<&str> = Some("roof-tiles.png");

const TABLE: [Row; 48] = [
    ("plaster cream", [0.86, 0.74, 0.50], 0.9, 0.0, PLASTER, 3.0),
    ("plaster ochre", [0.78, 0.52, 0.22], 0.9, 0.0, PLASTER, 3.0),
    ("plaster rose", [0.74, 0.40, 0.33], 0.9, 0.0, PLASTER, 3.0),
    ("plaster white", [0.86, 0.85, 0.80], 0.9, 0.0, PLASTER, 3.0),
    ("plaster green", [0.45, 0.58, 0.42], 0.9, 0.0, PLASTER, 3.0),
    ("plaster blue", [0.42, 0.54, 0.66], 0.9, 0.0, PLASTER, 3.0),
    ("plaster grey", [0.56, 0.54, 0.50], 0.9, 0.0, PLASTER, 3.0),
    ("plaster red", [0.56, 0.20, 0.14], 0.9, 0.0, PLASTER, 3.0),
    ("brick red", [0.74, 0.42, 0.33], 0.85, 0.0, BRICK, 1.6),
    ("brick brown", [0.54, 0.38, 0.30], 0.85, 0.0, BRICK, 1.6),
    ("brick yellow", [0.92, 0.80, 0.60], 0.85, 0.0, BRICK, 1.6),
    ("ashlar pale", [0.90, 0.87, 0.80], 0.8, 0.0, ASHLAR, 2.4),
    ("ashlar sand", [0.84, 0.72, 0.54], 0.8, 0.0, ASHLAR, 2.4),
    ("tiles red", [0.72, 0.26, 0.14], 0.8, 0.0, TILES, 2.0),
    ("tiles brown", [0.42, 0.22, 0.15], 0.8, 0.0, TILES, 2.0),
    ("slate", [0.20, 0.22, 0.26], 0.55, 0.0, TILES, 2.0),
    ("trim pale", [0.78, 0.75, 0.68], 0.75, 0.0, None, 1.0),
    ("trim sand", [0.66, 0.55, 0.40], 0.8, 0.0, None, 1.0),
    ("paint white", [0.84, 0.83, 0.80], 0.5, 0.0, None, 1.0),
    ("paint green", [0.08, 0.18, 0.11], 0.45, 0.0, None, 1.0),
    ("paint brown", [0.18, 0.09, 0.05], 0.5, 0.0, None, 1.0),
    ("paint grey", [0.12, 0.13, 0.14], 0.45, 0.0, None, 1.0),
    ("glass", [0.045, 0.06, 0.075], 0.08, 0.0, None, 1.0),
    ("glass blue", [0.10, 0.19, 0.26], 0.06, 0.0, None, 1.0),
    ("iron", [0.03, 0.03, 0.035], 0.5, 0.0, None, 1.0),
    ("zinc", [0.36, 0.38, 0.40], 0.5, 0.4, None, 1.0),
    ("copper", [0.24, 0.46, 0.38], 0.7, 0.0, None, 1.0),
    ("concrete", [0.52, 0.51, 0.48], 0.9, 0.0, PLASTER, 3.0),
    ("gravel", [0.34, 0.33, 0.31], 0.95, 0.0, None, 1.0),
    ("asphalt", [0.24, 0.24, 0.25], 0.9, 0.0, Some("asphalt.png"), 8.0),
    ("paving", [0.60, 0.58, 0.54], 0.85, 0.0, Some("paving.png"), 2.0),
    ("marking", [0.80, 0.80, 0.78], 0.7, 0.0, None, 1.0),
    ("lawn", [0.10, 0.16, 0.05], 0.95, 0.0, None, 1.0),
    ("leaves light", [0.105, 0.175, 0.035], 0.8, 0.0, None, 1.0),
    ("leaves dark", [0.06, 0.12, 0.03], 0.8, 0.0, None, 1.0),
    ("bark", [0.16, 0.12, 0.085], 0.9, 0.0, None, 1.0),
    ("car silver", [0.55, 0.56, 0.58], 0.3, 0.5, None, 1.0),
    ("car red", [0.48, 0.04, 0.03], 0.3, 0.0, None, 1.0),
    ("car blue", [0.04, 0.10, 0.30], 0.3, 0.0, None, 1.0),
    ("car white", [0.80, 0.80, 0.78], 0.3, 0.0, None, 1.0),
    ("tyre", [0.02, 0.02, 0.02], 0.9, 0.0, None, 1.0),
    ("lamp", [0.90, 0.86, 0.74], 0.4, 0.0, None, 1.0),
    ("wood", [0.36, 0.20, 0.10], 0.7, 0.0, None, 1.0),
    ("awning red", [0.58, 0.08, 0.06], 0.85, 0.0, None, 1.0),
    ("awning green", [0.06, 0.28, 0.16], 0.85, 0.0, None, 1.0),
    ("awning blue", [0.06, 0.16, 0.36], 0.85, 0.0, None, 1.0),
    ("clay", [0.56, 0.25, 0.14], 0.8, 0.0, None, 1.0),
    ("steel", [0.30, 0.32, 0.34], 0.35, 0.6, None, 1.0),
];

/// The material of a name. The names are constants of this module, so a misspelt one fails every test.
pub(super) fn named(name: &str) -> Material {
    let found = TABLE.iter().position(|row| row.0 == name);
    debug_assert!(found.is_some(), "no material {name}");
    found.unwrap_or_default()
}

/// The materials whose names begin with `kind`.
pub(super) fn of_kind(kind: &str) -> Vec<Material> {
    (0..TABLE.len()).filter(|&material| TABLE[material].0.starts_with(kind)).collect()
}

/// Length of a texture repeat in metres.
pub(super) fn tile(material: Material) -> f64 {
    TABLE[material].5
}

/// Whether a material has a texture, so that its faces need texture coordinates.
pub(super) fn is_textured(material: Material) -> bool {
    TABLE[material].4.is_some()
}

/// The glTF properties `materials`, `textures`, `images` and `samplers`.
pub(super) fn json() -> String {
    let mut images: Vec<&str> = Vec::new();
    let mut list = Vec::new();
    for (name, [r, g, b], roughness, metal, texture, _) in TABLE {
        let mut metallic = format!(
            "\"baseColorFactor\":[{r},{g},{b},1],\"metallicFactor\":{metal},\"roughnessFactor\":{roughness}"
        );
        if let Some(file) = texture {
            let index = images.iter().position(|image| *image == file).unwrap_or_else(|| {
                images.push(file);
                images.len() - 1
            });
            // Writing to a String cannot fail.
            let _ = write!(metallic, ",\"baseColorTexture\":{{\"index\":{index}}}");
        }
        list.push(format!("{{\"name\":\"{name}\",\"pbrMetallicRoughness\":{{{metallic}}}}}"));
    }
    let textures: Vec<String> =
        (0..images.len()).map(|image| format!("{{\"sampler\":0,\"source\":{image}}}")).collect();
    let images: Vec<String> = images.iter().map(|file| format!("{{\"uri\":\"{file}\"}}")).collect();
    format!(
        "\"materials\":[{}],\"textures\":[{}],\"images\":[{}],\"samplers\":[{{\"wrapS\":10497,\"wrapT\":10497}}]",
        list.join(","),
        textures.join(","),
        images.join(",")
    )
}
