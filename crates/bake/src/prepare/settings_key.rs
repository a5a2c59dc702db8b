//! The bytes of an asset's settings that enter the key of its pack: an explicit, versioned encoding, so that a key
//! depends on no type's debug output.

use lodestream_geometry::base::FORMAT_VERSION;
use lodestream_geometry::pack::PACK_VERSION;
use lodestream_geometry::quantise::{Precision, QuantiseSettings};
use lodestream_geometry::{Codec, Metric, Settings};
use lodestream_import::Part;
use lodestream_import::texture::TextureSettings;

use crate::preparation_settings::{CodecChoice, ReliefDepth};
use crate::scene::Asset;

/// Version of the encoding. Increment it when a field is added, removed or reordered, or a tag changes its meaning.
const VERSION: u16 = 5;

/// Everything besides the model's files that determines a pack. Threads and progress do not.
#[derive(Clone, Debug)]
pub(super) struct PackSettings<'a> {
    /// Name of the asset, which its description contains.
    pub(super) name: &'a str,
    /// Part of the model file; `None` if what is imported of it is hashed beside these settings.
    pub(super) part: Option<Part>,
    /// Grids and normals.
    pub(super) quantise: QuantiseSettings,
    /// Where surfaces without normals are smooth, in degrees.
    pub(super) crease_angle: f64,
    /// Simplification and coding; `codec` below takes the place of its codec.
    pub(super) simplify: Settings,
    /// Codec, or the rule that selects one.
    pub(super) codec: CodecChoice,
    /// Depth of relief instead of the materials', in units of texture coordinates.
    pub(super) relief_depth: Option<f32>,
    /// How textures are encoded.
    pub(super) textures: TextureSettings,
}

impl<'a> PackSettings<'a> {
    /// The settings of an asset.
    pub(super) fn of(asset: &'a Asset) -> Self {
        let Asset { name, file: _, part, preparation_settings } = asset;
        Self {
            name,
            part: Some(part.clone()),
            quantise: preparation_settings.quantise_settings(),
            crease_angle: preparation_settings.crease_angle().get(),
            simplify: asset.simplify_settings(),
            codec: preparation_settings.codec(),
            relief_depth: preparation_settings.relief_depth.map(ReliefDepth::get),
            textures: preparation_settings.texture_settings(),
        }
    }
}

/// Version of packs, which enters their keys.
pub(crate) fn pack_version() -> u32 {
    u32::from(PACK_VERSION) << 8 | u32::from(FORMAT_VERSION)
}

impl PackSettings<'_> {
    /// Encodes all fields in the order of their declaration: integers in 8 bytes and floating-point numbers as their
    /// bits, little-endian; the name with its length before it; options and enums with a tag of one byte.
    ///
    /// The patterns name every field, so a new one does not compile until it is encoded here.
    pub(super) fn encode(&self) -> Vec<u8> {
        let Self { name, ref part, quantise, crease_angle, simplify, codec, relief_depth, textures } = *self;
        let mut bytes = VERSION.to_le_bytes().to_vec();
        put_count(&mut bytes, name.len());
        bytes.extend(name.as_bytes());
        match part {
            None => bytes.push(3),
            Some(Part::Whole) => bytes.push(0),
            Some(Part::Mesh { mesh, linear }) => {
                bytes.push(1);
                put_count(&mut bytes, *mesh);
                linear.iter().flatten().for_each(|&number| put_number(&mut bytes, number));
            }
            Some(Part::Batch(members)) => {
                bytes.push(2);
                put_count(&mut bytes, members.len());
                for member in &**members {
                    put_count(&mut bytes, member.mesh);
                    member.to_scene.iter().flatten().for_each(|&number| put_number(&mut bytes, number));
                }
            }
        }
        put_quantise(&mut bytes, quantise);
        put_number(&mut bytes, crease_angle);
        put_simplify(&mut bytes, simplify);
        bytes.push(match codec {
            CodecChoice::Auto => 0,
            CodecChoice::Codec(Codec::Range) => 1,
            CodecChoice::Codec(Codec::AxisAligned) => 2,
            CodecChoice::Codec(Codec::Zstd) => 3,
        });
        put_option(&mut bytes, relief_depth.map(f64::from));
        let TextureSettings { quality, effort } = textures;
        bytes.extend([quality.get(), effort.get()]);
        bytes
    }
}

fn put_quantise(bytes: &mut Vec<u8>, settings: QuantiseSettings) {
    let QuantiseSettings { precision, uv_bits, normal_tolerance } = settings;
    match precision {
        Precision::Bits(bits) => bytes.extend([0, bits]),
        Precision::Tolerance(length) => {
            bytes.push(1);
            put_number(bytes, length);
        }
    }
    bytes.push(uv_bits);
    put_number(bytes, normal_tolerance);
}

fn put_simplify(bytes: &mut Vec<u8>, settings: Settings) {
    let Settings {
        region_faces,
        level_share,
        top_regions,
        base_error,
        visible_side,
        min_splits,
        parts,
        min_part_splits,
        metric,
        round_share,
        codec: _,
        coarse_grid,
        block_faces,
        unlock_outlines,
    } = settings;
    put_count(bytes, region_faces);
    put_number(bytes, level_share);
    put_number(bytes, top_regions);
    put_number(bytes, base_error);
    put_number(bytes, visible_side);
    put_count(bytes, min_splits);
    put_count(bytes, parts);
    put_count(bytes, min_part_splits);
    bytes.push(match metric {
        Metric::Qem => 0,
        Metric::Melax => 1,
        Metric::Clustering => 2,
        Metric::ClusteringSeams => 3,
    });
    put_option(bytes, round_share);
    put_number(bytes, coarse_grid);
    put_count(bytes, block_faces);
    bytes.push(u8::from(unlock_outlines));
}

fn put_count(bytes: &mut Vec<u8>, count: usize) {
    bytes.extend((count as u64).to_le_bytes());
}

fn put_number(bytes: &mut Vec<u8>, number: f64) {
    bytes.extend(number.to_bits().to_le_bytes());
}

fn put_option(bytes: &mut Vec<u8>, number: Option<f64>) {
    bytes.push(u8::from(number.is_some()));
    number.into_iter().for_each(|number| put_number(bytes, number));
}

#[cfg(test)]
mod tests {
    use lodestream_import::BatchMember;

    use super::*;

    const DEFAULT_LINEAR: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    const MEMBER: BatchMember = BatchMember { mesh: 2, to_scene: [[0.5; 4]; 4] };

    fn default() -> PackSettings<'static> {
        PackSettings {
            name: "a",
            part: Some(Part::Whole),
            quantise: QuantiseSettings::default(),
            crease_angle: 40.0,
            simplify: Settings::default(),
            codec: CodecChoice::Auto,
            relief_depth: None,
            textures: TextureSettings::default(),
        }
    }

    #[test]
    fn any_changed_setting_changes_the_encoding() {
        type Change = (&'static str, fn(&mut PackSettings<'static>));
        let changes: Vec<Change> = vec![
            ("name", |s| s.name = "b"),
            ("longer name", |s| s.name = "a\0"),
            ("part", |s| s.part = Some(Part::Mesh { mesh: 0, linear: DEFAULT_LINEAR })),
            ("mesh", |s| s.part = Some(Part::Mesh { mesh: 1, linear: DEFAULT_LINEAR })),
            ("linear", |s| {
                let mut linear = DEFAULT_LINEAR;
                linear[2][1] = 0.5;
                s.part = Some(Part::Mesh { mesh: 0, linear });
            }),
            ("content", |s| s.part = None),
            ("batch", |s| s.part = Some(Part::Batch([MEMBER].into()))),
            ("batch of two", |s| s.part = Some(Part::Batch([MEMBER; 2].into()))),
            ("batch member", |s| s.part = Some(Part::Batch([BatchMember { mesh: 3, ..MEMBER }].into()))),
            ("batch place", |s| {
                let mut to_scene = MEMBER.to_scene;
                to_scene[3][0] = 1.0;
                s.part = Some(Part::Batch([BatchMember { to_scene, ..MEMBER }].into()));
            }),
            ("position bits", |s| s.quantise.precision = Precision::Bits(10)),
            ("tolerance", |s| s.quantise.precision = Precision::Tolerance(0.1)),
            ("another tolerance", |s| s.quantise.precision = Precision::Tolerance(0.2)),
            ("uv bits", |s| s.quantise.uv_bits += 1),
            ("normal tolerance", |s| s.quantise.normal_tolerance += 1.0),
            ("crease angle", |s| s.crease_angle += 1.0),
            ("region faces", |s| s.simplify.region_faces += 1),
            ("level share", |s| s.simplify.level_share += 0.01),
            ("top regions", |s| s.simplify.top_regions += 0.5),
            ("base error", |s| s.simplify.base_error += 0.01),
            ("visible side", |s| s.simplify.visible_side += 0.01),
            ("min splits", |s| s.simplify.min_splits += 1),
            ("parts", |s| s.simplify.parts += 1),
            ("min part splits", |s| s.simplify.min_part_splits += 1),
            ("melax", |s| s.simplify.metric = Metric::Melax),
            ("clustering", |s| s.simplify.metric = Metric::Clustering),
            ("clustering-seams", |s| s.simplify.metric = Metric::ClusteringSeams),
            ("rounds", |s| s.simplify.round_share = Some(0.0)),
            ("round share", |s| s.simplify.round_share = Some(0.1)),
            ("coarse grid", |s| s.simplify.coarse_grid += 0.5),
            ("block faces", |s| s.simplify.block_faces += 1),
            ("outlines", |s| s.simplify.unlock_outlines = true),
            ("range", |s| s.codec = Codec::Range.into()),
            ("axis-aligned", |s| s.codec = Codec::AxisAligned.into()),
            ("zstd", |s| s.codec = Codec::Zstd.into()),
            ("relief", |s| s.relief_depth = Some(0.0)),
            ("relief depth", |s| s.relief_depth = Some(0.1)),
            ("texture quality", |s| s.textures.quality = 100.try_into().unwrap()),
            ("texture effort", |s| s.textures.effort = 0.try_into().unwrap()),
        ];
        let mut encodings = vec![("default", default().encode())];
        for (name, change) in changes {
            let mut settings = default();
            change(&mut settings);
            encodings.push((name, settings.encode()));
        }
        for (i, (name, bytes)) in encodings.iter().enumerate() {
            for (other, other_bytes) in &encodings[i + 1..] {
                assert_ne!(bytes, other_bytes, "{name} and {other}");
            }
        }
    }

    /// A change of the layout that forgets [`VERSION`] fails here: update both together.
    #[test]
    fn the_encoding_of_the_defaults_is_fixed() {
        let bytes = default().encode();
        assert_eq!(bytes[..2], VERSION.to_le_bytes());
        assert_eq!(
            bytes.len(),
            2 + 9 + 1 + (2 + 1 + 8) + 8 + (3 * 8 + 2 * 8 + 3 * 8 + 1 + 1 + 8 + 8 + 1) + 1 + 1 + 2
        );
    }
}
