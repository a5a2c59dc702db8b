//! What a material reflects besides its base: as `KHR_materials_ior`, `KHR_materials_specular` and
//! `KHR_materials_clearcoat` set it.

use super::shares::{from_u8, to_u8};
use crate::encoding::{CodingError, Decode, Encode, Reader, Writer};

/// Reflectance of a dielectric between the directions straight at it and along it (Schlick, "An inexpensive BRDF model
/// for physically-based rendering", 1994).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Specular {
    /// Straight at it, linear RGB, each in 0..=1. Kept as its square root, the Fresnel equations' amplitude, in steps of
    /// 1/255.
    pub f0: [f32; 3],
    /// Along it, in 0..=1; kept in steps of 1/255.
    pub f90: f32,
}

impl Default for Specular {
    /// Of an index of refraction of 1.5.
    fn default() -> Self {
        Self { f0: [0.04; 3], f90: 1.0 }
    }
}

impl Specular {
    /// Roots of `f0`, and `f90`, in 255ths, as they are sent and drawn.
    #[must_use]
    pub fn bytes(&self) -> [u8; 4] {
        let [r, g, b] = self.f0.map(|f0| to_u8(f0.max(0.0).sqrt()));
        [r, g, b, to_u8(self.f90)]
    }

    /// What [`Self::bytes`] stand for.
    #[must_use]
    pub fn of_bytes([r, g, b, f90]: [u8; 4]) -> Self {
        Self { f0: [r, g, b].map(|root| from_u8(root) * from_u8(root)), f90: from_u8(f90) }
    }

    /// Whether it is the default as far as is kept.
    #[must_use]
    pub fn is_usual(&self) -> bool {
        self.bytes() == Self::default().bytes()
    }
}

impl Encode for Specular {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        self.bytes().encode(writer)
    }
}

impl Decode for Specular {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        Ok(Self::of_bytes(Decode::decode(reader)?))
    }
}

/// A clear coat over the rest, which reflects 0.04 straight on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClearCoat {
    /// Share of the surface that it covers, in 0..=1; kept in steps of 1/255.
    pub factor: f32,
    /// Its perceptual roughness, in 0..=1; kept in steps of 1/255.
    pub roughness: f32,
}

impl ClearCoat {
    fn bytes(&self) -> [u8; 2] {
        [self.factor, self.roughness].map(to_u8)
    }

    /// Whether there is none as far as is kept.
    #[must_use]
    pub fn is_none(&self) -> bool {
        to_u8(self.factor) == 0
    }
}

impl Encode for ClearCoat {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        self.bytes().encode(writer)
    }
}

impl Decode for ClearCoat {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let [factor, roughness] = <[u8; 2]>::decode(reader)?.map(from_u8);
        Ok(Self { factor, roughness })
    }
}
