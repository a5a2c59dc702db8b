//! Materials: metallic–roughness as in glTF 2.0 (§3.9), with emission, alpha mode and maps.

use super::shares::{from_u8, to_u8, to_u16};
use super::specular::{ClearCoat, Specular};
use crate::encoding::{CodingError, Decode, Encode, Reader, Writer};

/// Largest emission of a material, in the scene's units of light.
pub const MAX_EMISSION: f32 = 65_504.0;
/// Largest scale of a normal map.
pub const MAX_NORMAL_SCALE: f32 = 64.0;

/// Surface parameters of the faces that name this material.
///
/// Maps use the first of the vertices' two sets of texture coordinates, unless [`Material::second_uv`] says otherwise,
/// and the same wrap modes.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name for people.
    pub name: String,
    /// Linear red, green, blue and opacity, each in 0..=1; kept in steps of 1/65535. Multiplies the
    /// base colour texture, if any.
    pub base_color: [f32; 4],
    /// Perceptual roughness in 0..=1, kept in steps of 1/255; multiplies the surface texture's green.
    pub roughness: f32,
    /// Metalness: 0 is a dielectric, 1 a metal of the base colour. In 0..=1, kept in steps of 1/255;
    /// multiplies the surface texture's blue.
    pub metallic: f32,
    /// What it reflects as a dielectric.
    pub specular: Specular,
    /// A coat over all of it but its emission.
    pub clear_coat: ClearCoat,
    /// Share of what enters its base that a thin wall lets through, tinted by the base colour (`KHR_materials_transmission`),
    /// in 0..=1; kept in steps of 1/255. 0 unless it is blended.
    pub transmission: f32,
    /// Emitted light, linear RGB, each in 0..=[`MAX_EMISSION`]. Multiplies the emission
    /// texture, if any.
    pub emission: [f32; 3],
    /// Alpha mode.
    pub alpha: Alpha,
    /// Whether the base colour is drawn without lighting and without emission (`KHR_materials_unlit`).
    pub unlit: bool,
    /// Whether faces are shaded by their own normals, those of their corners ignored.
    pub flat: bool,
    /// How maps continue beyond 0..=1, along u and along v.
    pub wrap: [Wrap; 2],
    /// Which maps use the second set of texture coordinates.
    pub second_uv: SecondUv,
    /// Index of the colour texture.
    pub base_color_texture: Option<u16>,
    /// Index of the texture of occlusion (red), roughness (green) and metal (blue).
    pub surface_texture: Option<u16>,
    /// Index of a texture of occlusion (red) that uses the other set of texture coordinates than the surface texture, whose
    /// red is 1 then.
    pub occlusion_texture: Option<u16>,
    /// Index of the normal map: x along u, y along v upwards, z out of the surface.
    pub normal_texture: Option<u16>,
    /// Factor on the x and y of the normal map, in 0..=[`MAX_NORMAL_SCALE`]. 1 without one.
    pub normal_scale: f32,
    /// Index of the texture of emitted colours.
    pub emission_texture: Option<u16>,
    /// Index of the height map for relief mapping; white is the surface, black is the deepest point.
    pub height_texture: Option<u16>,
    /// Depth of black in the height map below the surface, in units of texture coordinates
    /// (uv space: 0.05 is a twentieth of the texture's width). Zero without height map.
    pub relief_depth: f32,
}

/// Maps that use the second set of texture coordinates. The occlusion texture uses the other set than the surface texture,
/// the height map the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SecondUv {
    /// The colour texture.
    pub color: bool,
    /// The surface texture.
    pub surface: bool,
    /// The normal map.
    pub normal: bool,
    /// The texture of emitted colours.
    pub emission: bool,
}

impl SecondUv {
    /// Bits of the flags, in the order of the fields.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.color as u8 | (self.surface as u8) << 1 | (self.normal as u8) << 2 | (self.emission as u8) << 3
    }

    fn of(bits: u8) -> Self {
        let is = |bit: u8| bits & 1 << bit != 0;
        Self { color: is(0), surface: is(1), normal: is(2), emission: is(3) }
    }
}

/// Alpha mode, as in glTF.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Alpha {
    /// Opacity is ignored.
    #[default]
    Opaque,
    /// Alpha test: drawn where opacity is at least this cutoff, in 0..=1, kept in steps of 1/255.
    Mask(f32),
    /// Alpha blending.
    Blend,
}

/// Wrap mode of a texture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// Repeats.
    #[default]
    Repeat,
    /// Clamps to the edge.
    Clamp,
    /// Repeats mirrored.
    Mirror,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: [0.8, 0.8, 0.8, 1.0],
            roughness: 0.8,
            metallic: 0.0,
            specular: Specular::default(),
            clear_coat: ClearCoat::default(),
            transmission: 0.0,
            emission: [0.0; 3],
            alpha: Alpha::Opaque,
            unlit: false,
            flat: false,
            wrap: [Wrap::Repeat; 2],
            second_uv: SecondUv::default(),
            base_color_texture: None,
            surface_texture: None,
            occlusion_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            emission_texture: None,
            height_texture: None,
            relief_depth: 0.0,
        }
    }
}

impl Material {
    /// Indices of its textures, in the order of the fields.
    pub fn textures(&self) -> impl Iterator<Item = u16> {
        let all = [
            self.base_color_texture,
            self.surface_texture,
            self.occlusion_texture,
            self.normal_texture,
            self.emission_texture,
            self.height_texture,
        ];
        all.into_iter().flatten()
    }

    /// Its textures that use the second set of texture coordinates.
    pub fn second_textures(&self) -> impl Iterator<Item = u16> {
        let SecondUv { color, surface, normal, emission } = self.second_uv;
        let all = [
            self.base_color_texture.filter(|_| color),
            self.surface_texture.filter(|_| surface),
            self.occlusion_texture.filter(|_| !surface),
            self.normal_texture.filter(|_| normal),
            self.emission_texture.filter(|_| emission),
        ];
        all.into_iter().flatten()
    }

    /// Opacity for pictures that show transmission as plain opacity, without refraction or tint. Full transmission leaves a
    /// tenth, so that a pane stays visible.
    #[must_use]
    pub fn plain_opacity(&self) -> f32 {
        self.base_color[3] * (1.0 - 0.9 * self.transmission)
    }

    /// Whether it emits light; an unlit material does not.
    #[must_use]
    pub fn emits(&self) -> bool {
        !self.unlit && self.emission.iter().any(|&light| light > 0.0)
    }
}

/// Bits of the first byte: optional fields that are present.
mod has {
    pub(super) const COLOR: u8 = 1;
    pub(super) const HEIGHT: u8 = 2;
    pub(super) const METAL: u8 = 4;
    pub(super) const EMISSION: u8 = 8;
    pub(super) const SURFACE_TEXTURE: u8 = 16;
    pub(super) const NORMAL_TEXTURE: u8 = 32;
    pub(super) const EMISSION_TEXTURE: u8 = 64;
    /// A second byte follows.
    pub(super) const MORE: u8 = 128;
}

/// Bits of the second byte.
mod more {
    pub(super) const MASK: u8 = 1;
    pub(super) const BLEND: u8 = 2;
    /// In place of both: a third byte follows, which begins with them.
    pub(super) const THIRD: u8 = 3;
    pub(super) const UNLIT: u8 = 4;
    /// Two bits each: 0 repeat, 1 clamp, 2 mirror.
    pub(super) const WRAP_U: u8 = 8;
    pub(super) const WRAP_V: u8 = 32;
    pub(super) const FLAT: u8 = 128;
}

/// Bits of the third byte, after [`more::MASK`] and [`more::BLEND`].
mod third {
    pub(super) const SPECULAR: u8 = 4;
    pub(super) const CLEAR_COAT: u8 = 8;
    pub(super) const TRANSMISSION: u8 = 16;
    /// A byte: flags of [`SecondUv`](super::SecondUv), and from bit 4 on whether an occlusion texture follows.
    pub(super) const SECOND_UV: u8 = 32;
    pub(super) const ALL: u8 = 63;
}

/// Bit of the byte of [`third::SECOND_UV`].
const OCCLUSION_TEXTURE: u8 = 16;

fn wrap_bits(wrap: Wrap) -> u8 {
    match wrap {
        Wrap::Repeat => 0,
        Wrap::Clamp => 1,
        Wrap::Mirror => 2,
    }
}

fn wrap_of(bits: u8) -> Result<Wrap, CodingError> {
    match bits & 3 {
        0 => Ok(Wrap::Repeat),
        1 => Ok(Wrap::Clamp),
        2 => Ok(Wrap::Mirror),
        _ => Err(CodingError::value("unknown wrap mode")),
    }
}

impl Material {
    fn alpha_bits(&self) -> u8 {
        match self.alpha {
            Alpha::Opaque => 0,
            Alpha::Mask(_) => more::MASK,
            Alpha::Blend => more::BLEND,
        }
    }

    /// `None` without any field that it tells of.
    fn third_byte(&self) -> Option<u8> {
        let present = [
            (third::SPECULAR, !self.specular.is_usual()),
            (third::CLEAR_COAT, !self.clear_coat.is_none()),
            (third::TRANSMISSION, to_u8(self.transmission) > 0),
            (third::SECOND_UV, self.second_uv_byte() > 0),
        ];
        let present: u8 = present.iter().map(|&(bit, is)| if is { bit } else { 0 }).sum();
        (present > 0).then(|| present | self.alpha_bits())
    }

    fn second_uv_byte(&self) -> u8 {
        self.second_uv.bits() | if self.occlusion_texture.is_some() { OCCLUSION_TEXTURE } else { 0 }
    }

    fn second_byte(&self) -> u8 {
        let alpha = if self.third_byte().is_some() { more::THIRD } else { self.alpha_bits() };
        let [u, v] = self.wrap.map(wrap_bits);
        let unlit = if self.unlit { more::UNLIT } else { 0 };
        let flat = if self.flat { more::FLAT } else { 0 };
        alpha | unlit | flat | (u * more::WRAP_U) | (v * more::WRAP_V)
    }

    fn first_byte(&self) -> u8 {
        let present = [
            (has::COLOR, self.base_color_texture.is_some()),
            (has::HEIGHT, self.height_texture.is_some()),
            (has::METAL, to_u8(self.metallic) > 0),
            (has::EMISSION, self.emission != [0.0; 3]),
            (has::SURFACE_TEXTURE, self.surface_texture.is_some()),
            (has::NORMAL_TEXTURE, self.normal_texture.is_some()),
            (has::EMISSION_TEXTURE, self.emission_texture.is_some()),
            (has::MORE, self.second_byte() != 0),
        ];
        present.iter().map(|&(bit, is)| if is { bit } else { 0 }).sum()
    }
}

// By hand: bytes of flags instead of one per option, and fixed-point colours (8 bytes, not 20). A material that needs
// none of what most lack takes 11 bytes and its name.
impl Encode for Material {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        self.first_byte().encode(writer)?;
        self.name.encode(writer)?;
        for x in self.base_color {
            to_u16(x).to_le_bytes().encode(writer)?;
        }
        to_u8(self.roughness).encode(writer)?;
        if let Some(texture) = self.base_color_texture {
            texture.encode(writer)?;
        }
        if let Some(texture) = self.height_texture {
            texture.encode(writer)?;
            self.relief_depth.encode(writer)?;
        }
        if to_u8(self.metallic) > 0 {
            to_u8(self.metallic).encode(writer)?;
        }
        if self.emission != [0.0; 3] {
            self.emission.encode(writer)?;
        }
        if let Some(texture) = self.surface_texture {
            texture.encode(writer)?;
        }
        if let Some(texture) = self.normal_texture {
            texture.encode(writer)?;
            self.normal_scale.encode(writer)?;
        }
        if let Some(texture) = self.emission_texture {
            texture.encode(writer)?;
        }
        if self.second_byte() != 0 {
            self.second_byte().encode(writer)?;
            if let Some(third) = self.third_byte() {
                third.encode(writer)?;
            }
            if let Alpha::Mask(cutoff) = self.alpha {
                to_u8(cutoff).encode(writer)?;
            }
            if !self.specular.is_usual() {
                self.specular.encode(writer)?;
            }
            if !self.clear_coat.is_none() {
                self.clear_coat.encode(writer)?;
            }
            if to_u8(self.transmission) > 0 {
                to_u8(self.transmission).encode(writer)?;
            }
            if self.second_uv_byte() > 0 {
                self.second_uv_byte().encode(writer)?;
            }
            if let Some(texture) = self.occlusion_texture {
                texture.encode(writer)?;
            }
        }
        Ok(())
    }
}

impl Decode for Material {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let flags = u8::decode(reader)?;
        let name = String::decode(reader)?;
        let mut base_color = [0.0; 4];
        for x in &mut base_color {
            *x = f32::from(u16::from_le_bytes(<[u8; 2]>::decode(reader)?)) / 65_535.0;
        }
        let roughness = from_u8(u8::decode(reader)?);
        let mut this = Self { name, base_color, roughness, ..Self::default() };
        let is = |bit| flags & bit != 0;
        if is(has::COLOR) {
            this.base_color_texture = Some(u16::decode(reader)?);
        }
        if is(has::HEIGHT) {
            (this.height_texture, this.relief_depth) = (Some(u16::decode(reader)?), f32::decode(reader)?);
        }
        if is(has::METAL) {
            this.metallic = from_u8(u8::decode(reader)?);
        }
        if is(has::EMISSION) {
            this.emission = <[f32; 3]>::decode(reader)?;
        }
        if is(has::SURFACE_TEXTURE) {
            this.surface_texture = Some(u16::decode(reader)?);
        }
        if is(has::NORMAL_TEXTURE) {
            (this.normal_texture, this.normal_scale) = (Some(u16::decode(reader)?), f32::decode(reader)?);
        }
        if is(has::EMISSION_TEXTURE) {
            this.emission_texture = Some(u16::decode(reader)?);
        }
        if is(has::MORE) {
            let second = u8::decode(reader)?;
            let has_third = second & more::THIRD == more::THIRD;
            let third = if has_third { u8::decode(reader)? } else { second & more::THIRD };
            if third & more::THIRD == more::THIRD || has_third && third & !third::ALL != 0 {
                return Err(CodingError::value("unknown material flags"));
            }
            this.unlit = second & more::UNLIT != 0;
            this.flat = second & more::FLAT != 0;
            this.wrap = [wrap_of(second / more::WRAP_U)?, wrap_of(second / more::WRAP_V)?];
            if third & more::MASK != 0 {
                this.alpha = Alpha::Mask(from_u8(u8::decode(reader)?));
            } else if third & more::BLEND != 0 {
                this.alpha = Alpha::Blend;
            }
            if third & third::SPECULAR != 0 {
                this.specular = Specular::decode(reader)?;
            }
            if third & third::CLEAR_COAT != 0 {
                this.clear_coat = ClearCoat::decode(reader)?;
            }
            if third & third::TRANSMISSION != 0 {
                this.transmission = from_u8(u8::decode(reader)?);
            }
            if third & third::SECOND_UV != 0 {
                let flags = u8::decode(reader)?;
                if flags & OCCLUSION_TEXTURE != 0 {
                    this.occlusion_texture = Some(u16::decode(reader)?);
                }
                this.second_uv = SecondUv::of(flags);
                if this.second_uv_byte() != flags {
                    return Err(CodingError::value("unknown material flags"));
                }
            }
            if this.third_byte() != has_third.then_some(third) {
                return Err(CodingError::value("a material flags what it has not"));
            }
        }
        if this.first_byte() != flags {
            // One description, one encoding: what is flagged and zero would come back shorter.
            return Err(CodingError::value("a material flags what it has not"));
        }
        Ok(this)
    }
}
