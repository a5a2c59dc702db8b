//! Normal maps: mip levels are normalised means of directions.

use lodestream_geometry::pool::Pool;
use lodestream_scene::asset::{NORMAL_PLANES, TextureKind};

use super::encode::levels;
use super::error::TextureError;
use super::levels::Texture;
use super::mip::{Plain, Plane};
use super::planes;
use super::quality::TextureSettings;
use super::rows::Rows;
use super::source::Transparency;
use super::strips::{STRIP_ROWS, Strips};
use crate::model::ImageSource;

/// Sample value of 0: samples are signed values with this offset.
const ZERO: i32 = 1 << 15;

pub(super) fn load(
    source: &ImageSource,
    (settings, pool): (TextureSettings, &dyn Pool),
) -> Result<Texture, TextureError> {
    let mut strips = Normals(Rows::open(source)?);
    let [width_px, height_px] = strips.size();
    // Planes hold unnormalised means of unit vectors, normalised only for writing: a level is the direction of the mean
    // over all texels that it covers.
    let encode = |_, plane: &Plane<3>| {
        let bytes: Vec<u8> = plane.samples.iter().flat_map(|s| bytes(unit(s.map(signed)))).collect();
        let Plane { width, height, .. } = *plane;
        planes::encode(&bytes, (width, height), NORMAL_PLANES, settings)
    };
    let (levels, _) = levels::<3, Plain>((&source.path, TextureKind::Normal), &mut strips, encode, pool)?;
    let transparency = Transparency::None;
    Ok(Texture {
        kind: TextureKind::Normal,
        width_px,
        height_px,
        planes: NORMAL_PLANES,
        transparency,
        mean: None,
        levels,
    })
}

/// Unit vectors.
struct Normals(Rows);

impl Strips<3> for Normals {
    fn size(&self) -> [u32; 2] {
        self.0.size()
    }

    fn next(&mut self) -> Result<Vec<[u16; 3]>, TextureError> {
        let rgb = self.0.next(STRIP_ROWS)?.into_rgb16();
        Ok(rgb.pixels().map(|p| sample(p.0)).collect())
    }
}

/// The unit vector of a texel. Those that point into the surface are level: files have x and y only.
fn sample(texel: [u16; 3]) -> [u16; 3] {
    let [x, y, z] = texel.map(|c| f64::from(2 * i32::from(c) - i32::from(u16::MAX)));
    unit([x, y, z.max(0.0)]).map(|x| (ZERO + (x * 32_767.0).round() as i32) as u16)
}

fn signed(sample: u16) -> f64 {
    f64::from(i32::from(sample) - ZERO)
}

/// Normalises; +z for a zero vector. Square roots and quotients are the same on every machine.
fn unit(vector: [f64; 3]) -> [f64; 3] {
    let length = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 { vector.map(|x| x / length) } else { [0.0, 0.0, 1.0] }
}

fn bytes(vector: [f64; 3]) -> [u8; 3] {
    vector.map(|x| ((x + 1.0) * 127.5).round() as u8)
}
