//! Settings of the selection, as types that hold only valid values.

use std::num::NonZeroUsize;

/// An invalid value of a setting.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SettingsError {
    /// A share that is not from 0 to 1.
    #[error("{0} is not a share; give a number from 0 to 1")]
    NotAShare(f32),
    /// A weight that is negative or not finite.
    #[error("{0} is not a weight; give a finite number that is not below 0")]
    NotAWeight(f32),
}

/// A share of a whole: 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Share(f32);

impl Share {
    /// 0.
    pub const NONE: Self = Self(0.0);
    /// 1.
    pub const ALL: Self = Self(1.0);

    /// A share.
    ///
    /// # Errors
    /// If it is not from 0 to 1.
    pub const fn new(share: f32) -> Result<Self, SettingsError> {
        if share >= 0.0 && share <= 1.0 { Ok(Self(share)) } else { Err(SettingsError::NotAShare(share)) }
    }

    /// The number.
    #[must_use]
    pub const fn get(self) -> f32 {
        self.0
    }
}

impl TryFrom<f32> for Share {
    type Error = SettingsError;
    fn try_from(share: f32) -> Result<Self, SettingsError> {
        Self::new(share)
    }
}

/// A relative weight: finite and not below 0.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Weight(f32);

impl Weight {
    /// A weight.
    ///
    /// # Errors
    /// If it is below 0 or not finite.
    pub const fn new(weight: f32) -> Result<Self, SettingsError> {
        if weight >= 0.0 && weight.is_finite() {
            Ok(Self(weight))
        } else {
            Err(SettingsError::NotAWeight(weight))
        }
    }

    /// The number.
    #[must_use]
    pub const fn get(self) -> f32 {
        self.0
    }
}

impl TryFrom<f32> for Weight {
    type Error = SettingsError;
    fn try_from(weight: f32) -> Result<Self, SettingsError> {
        Self::new(weight)
    }
}

/// Settings of the selection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SelectSettings {
    /// Most faces in use, over all assets (each asset once, however many instances it has). Above it
    /// the threshold rises.
    pub max_faces: u64,
    /// Most payload bytes in use. Above it the threshold rises.
    pub max_bytes: u64,
    /// Most texels of texture levels and tiles in use; each takes four bytes of GPU memory, of height maps one or two. By
    /// default three fifths of 256 MiB: the renderer's budget for tiles, of which they can fill two thirds.
    /// Tiles that the view does not need give way; what is beyond it then is not wanted.
    pub max_texels: u64,
    /// Chunks are undone below this fraction of the error at which they are applied. Values near 1 save memory, lower
    /// ones flicker less when the camera moves slightly.
    pub undo_below: Share,
    /// Chunks out of view are undone only while more than this share of `max_faces` is in use.
    pub keep_out_of_view: Share,
    /// Most wanted blobs that one call lists.
    pub max_wanted: NonZeroUsize,
    /// Share of the area that a texture covers which counts as different while the texture is a blur, relative to
    /// shapes.
    pub texture_weight: Weight,
    /// Weight of attribute errors ([`visible_error`]). Less saves bytes if texture and shading may lag behind
    /// geometry; 0 considers geometry only.
    ///
    /// [`visible_error`]: lodestream_geometry::screen::visible_error
    pub attribute_share: Share,
    /// Whether base meshes of instances out of view are wanted too, with the lowest priority.
    pub prefetch_bases: bool,
    /// Whether a proxy is replaced piece by piece, as base meshes arrive, and drawn without these parts
    /// ([`PartialProxy`](lodestream_scene::proxy::PartialProxy)). If off, by all of them at once.
    pub partial_proxies: bool,
    /// Whether chunks without wanted children are wanted only up to the first sufficient truncation point. If off, a
    /// view needs more bytes, and fewer requests follow when the camera approaches.
    pub truncation_points: bool,
    /// Whether occluded parts have the lowest priority, as far as occluders are known ([`AssetState::set_occluder`]).
    ///
    /// [`AssetState::set_occluder`]: super::AssetState::set_occluder
    pub hidden_last: bool,
    /// Whether parts out of view that may cast shadows into view are refined, with the lowest priority. They use at
    /// most a tenth of the bytes that the view itself needs, and nothing without a sun ([`Selector::set_to_sun`]).
    ///
    /// [`Selector::set_to_sun`]: super::Selector::set_to_sun
    pub shadows: bool,
}

impl Default for SelectSettings {
    fn default() -> Self {
        Self {
            max_faces: 8_000_000,
            max_bytes: 512 << 20,
            max_texels: 40 << 20,
            undo_below: Share(0.7),
            keep_out_of_view: Share(0.5),
            max_wanted: const { NonZeroUsize::new(512).unwrap() },
            texture_weight: Weight(0.02),
            attribute_share: Share::ALL,
            prefetch_bases: true,
            partial_proxies: true,
            truncation_points: true,
            hidden_last: true,
            shadows: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn out_of_range_settings_are_refused() {
        for bad in [f32::NAN, -0.1, 1.001, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(Share::new(bad).is_err(), "{bad}");
        }
        for bad in [f32::NAN, -0.1, f32::INFINITY] {
            assert!(Weight::new(bad).is_err(), "{bad}");
        }
        assert_eq!(Share::new(0.0), Ok(Share::NONE));
        assert_eq!(Share::new(1.0), Ok(Share::ALL));
        assert_eq!(Weight::new(3.0).map(Weight::get), Ok(3.0));
    }
}
