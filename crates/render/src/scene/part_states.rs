//! What the viewer does to parts of an asset's instances: hide and tint them.

use std::collections::BTreeMap;

/// How a part is drawn; by default, as it is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PartState {
    /// Draws nothing of the part, in no pass: it casts no shadow and occludes nothing.
    pub hidden: bool,
    /// Mixed into the part's base colour before it is lit.
    pub tint: Option<Tint>,
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
    pub const HIDDEN: Self = Self { hidden: true, tint: None };

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
    fn hides_all(&self) -> bool {
        self.others.hidden && self.parts.values().all(|state| state.hidden)
    }
}

/// States of the parts of an asset's instances.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartStates {
    /// State of all parts of the instances that are not listed.
    pub others: PartState,
    /// States by index among the asset's instances.
    pub instances: BTreeMap<u32, InstanceStates>,
}

/// [`PartStates`] as words for the GPU, and where those of an instance are.
#[derive(Debug, Default)]
pub(crate) struct PartWords {
    /// Of each instance: number of parts that follow, state of all others, states by part. Two zeros come first.
    pub(crate) words: Vec<u32>,
    /// Beginnings in `words`; `None` for instances that are hidden.
    starts: BTreeMap<u32, Option<u32>>,
    others: Option<u32>,
}

impl PartWords {
    pub(crate) fn new(states: &PartStates) -> Self {
        let mut words = vec![0; 2];
        let mut add = |states: &InstanceStates| {
            if states.hides_all() {
                return None;
            }
            let (start, others) = (words.len(), states.others.word());
            let count = states.parts.last_key_value().map_or(0, |(part, _)| part + 1);
            words.extend([count, others]);
            words.resize(start + 2 + count as usize, others);
            for (part, state) in &states.parts {
                words[start + 2 + *part as usize] = state.word();
            }
            Some(u32::try_from(start).unwrap_or(u32::MAX))
        };
        let starts = states.instances.iter().map(|(index, states)| (*index, add(states))).collect();
        let others = match states.others {
            others if others == PartState::default() => Some(0),
            others => add(&InstanceStates { others, ..Default::default() }),
        };
        Self { words, starts, others }
    }

    /// Where the states of an instance begin, 0 without any; `None` if nothing of it is drawn.
    pub(crate) fn start(&self, instance: usize) -> Option<u32> {
        let listed = u32::try_from(instance).ok().and_then(|index| self.starts.get(&index));
        listed.copied().unwrap_or(self.others)
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

    #[test]
    fn instances_find_their_states_and_hidden_ones_are_not_drawn() {
        let parts = |parts: &[(u32, PartState)]| parts.iter().copied().collect();
        let one = InstanceStates { others: PartState::default(), parts: parts(&[(2, PartState::HIDDEN)]) };
        let gone = InstanceStates { others: PartState::HIDDEN, parts: parts(&[(0, PartState::HIDDEN)]) };
        let alone = InstanceStates { others: PartState::HIDDEN, parts: parts(&[(1, PartState::default())]) };
        let instances = [(0, one), (3, gone), (4, alone)].into();
        let words = PartWords::new(&PartStates { others: PartState::default(), instances });
        let hidden = PartState::HIDDEN.word();
        assert_eq!(words.words, [0, 0, 3, 0, 0, 0, hidden, 2, hidden, hidden, 0]);
        assert_eq!([0, 1, 3, 4].map(|index| words.start(index)), [Some(2), Some(0), None, Some(7)]);
        let isolated = PartStates { others: PartState::HIDDEN, ..Default::default() };
        assert_eq!(PartWords::new(&isolated).start(9), None);
    }
}
