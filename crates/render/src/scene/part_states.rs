//! What the viewer does to parts of an asset's instances: hide, tint and move them.

use std::collections::BTreeMap;

use lodestream_scene::animation::SkinPose;
use lodestream_scene::parts::PartTransform;

/// How a part is drawn; by default, as it is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PartState {
    /// Draws nothing of the part, in no pass: it casts no shadow and occludes nothing.
    pub hidden: bool,
    /// Mixed into the part's base colour before it is lit.
    pub tint: Option<Tint>,
    /// Moves it within its instance.
    pub transform: Option<PartTransform>,
}

/// A colour that is mixed into a surface's own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tint {
    /// The colour, sRGB-encoded.
    pub colour: [u8; 3],
    /// Its share of the mixture, 0 to 1, to the nearest 1/127; other values count as the nearer of the two.
    pub strength: f32,
}

/// Largest stored strength of a tint.
const STRENGTHS: f32 = 127.0;
pub(crate) const HIDDEN: u32 = 1 << 31;

impl PartState {
    /// A state that hides a part.
    pub const HIDDEN: Self = Self { hidden: true, tint: None, transform: None };

    /// The state as shaders read it: red, green, blue, strength and, in the highest bit, hidden.
    pub(crate) fn word(&self) -> u32 {
        let tint = self.tint.map_or(0, |Tint { colour: [r, g, b], strength }| {
            // `as` maps NaN to 0.
            let strength = (strength.clamp(0.0, 1.0) * STRENGTHS).round() as u8;
            if strength == 0 { 0 } else { u32::from_le_bytes([r, g, b, strength]) }
        });
        tint | if self.hidden { HIDDEN } else { 0 }
    }
}

/// States of an instance's parts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InstanceStates {
    /// State of all parts that are not listed.
    pub others: PartState,
    /// States by part.
    pub parts: BTreeMap<u32, PartState>,
}

impl InstanceStates {
    /// Whether no part is drawn, whatever parts there are.
    pub(crate) fn hides_all(&self) -> bool {
        self.others.hidden && self.parts.values().all(|state| state.hidden)
    }

    /// The transforms of its parts, those of all others first.
    pub(crate) fn transforms(&self) -> impl Iterator<Item = &PartTransform> {
        [&self.others].into_iter().chain(self.parts.values()).filter_map(|state| state.transform.as_ref())
    }
}

/// States of the parts of an asset's instances.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartStates {
    /// State of all parts of the instances that are not listed.
    pub others: PartState,
    /// States by index among the asset's instances.
    pub instances: BTreeMap<u32, InstanceStates>,
    /// Poses of instances whose vertices follow joints, by the same index.
    pub poses: BTreeMap<u32, SkinPose>,
}

impl PartStates {
    /// Whether any part is moved, or any vertex by its joints.
    pub(crate) fn moves(&self) -> bool {
        let listed = self.instances.values().any(|states| states.transforms().next().is_some());
        self.others.transform.is_some() || listed || !self.poses.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tinted(strength: f32) -> PartState {
        PartState { tint: Some(Tint { colour: [1, 2, 3], strength }), ..Default::default() }
    }

    #[test]
    fn words_hold_states() {
        assert_eq!(PartState::default().word(), 0);
        assert_eq!(PartState::HIDDEN.word(), 0x8000_0000);
        assert_eq!(tinted(1.0).word(), 0x7f03_0201);
        assert_eq!(tinted(7.0).word(), 0x7f03_0201);
        assert_eq!(tinted(f32::NAN).word(), 0);
        assert_eq!(PartState { hidden: true, ..tinted(0.5) }.word(), 0xc003_0201);
    }
}
