//! States of parts as words for the GPU.

use std::collections::BTreeMap;

use glam::DVec3;
use lodestream_scene::animation::SkinPose;
use lodestream_scene::parts::PartTransform;

use crate::scene::part_states::{InstanceStates, PartState, PartStates};

/// Words of a header: number of parts that follow, where the places of their moves begin, and where its pose does; 0
/// without any.
const HEADER: usize = 3;
/// Place of the pose in it.
const POSE: usize = 2;

/// [`PartStates`] as words for the GPU, and where those of an instance are.
#[derive(Debug, Default)]
pub(crate) struct PartWords {
    /// Of each instance: the header, state of all parts that are not listed, states by part. Then, if it has moves, where
    /// the move of each of these is (0: none), and the moves, eight words each. Then, if it has a pose, the number of
    /// joints and the map of each: three rows of four. Zeros come first: an instance without states.
    pub(crate) words: Vec<u32>,
    /// Beginnings in `words`; `None` for instances that are hidden.
    starts: BTreeMap<u32, Option<u32>>,
    others: Option<u32>,
}

impl PartWords {
    /// Words of states of an asset whose vertices are relative to `origin`.
    pub(crate) fn new(states: &PartStates, origin: DVec3) -> Self {
        let mut this = Self { words: vec![0; HEADER + 1], ..Self::default() };
        (this.starts, this.others) = this.add(states, origin);
        this
    }

    /// Appends the words of other states; the result has their beginnings only.
    pub(crate) fn append(&mut self, states: &PartStates, origin: DVec3) -> Self {
        let (starts, others) = self.add(states, origin);
        Self { words: Vec::new(), starts, others }
    }

    fn add(&mut self, states: &PartStates, origin: DVec3) -> (BTreeMap<u32, Option<u32>>, Option<u32>) {
        let unlisted = InstanceStates { others: states.others, ..Default::default() };
        let posed = states.poses.keys().map(|index| (*index, &unlisted));
        let mut instances: BTreeMap<u32, &InstanceStates> = posed.collect();
        instances.extend(states.instances.iter().map(|(index, states)| (*index, states)));
        let add = |(index, own): (u32, &InstanceStates)| {
            let start = self.add_instance(own, origin);
            if let (Some(start), Some(pose)) = (start, states.poses.get(&index)) {
                self.words[start as usize + POSE] = self.add_pose(pose, origin);
            }
            (index, start)
        };
        let starts = instances.into_iter().map(add).collect();
        let others = match states.others {
            others if others == PartState::default() => Some(0),
            _ => self.add_instance(&unlisted, origin),
        };
        (starts, others)
    }

    fn add_instance(&mut self, states: &InstanceStates, origin: DVec3) -> Option<u32> {
        if states.hides_all() {
            return None;
        }
        let start = self.place();
        let count = states.parts.last_key_value().map_or(0, |(part, _)| part + 1);
        let listed = |part: u32| states.parts.get(&part).unwrap_or(&states.others);
        let all = || [&states.others].into_iter().chain((0..count).map(listed));
        self.words.extend([count, 0, 0]);
        self.words.extend(all().map(PartState::word));
        if states.transforms().next().is_none() {
            return Some(start);
        }
        let moves = self.place();
        self.words[start as usize + 1] = moves;
        self.words.resize(self.words.len() + 1 + count as usize, 0);
        // Parts that are moved together follow one another.
        let mut last: Option<(PartTransform, u32)> = None;
        for (entry, state) in (moves as usize..).zip(all()) {
            let Some(transform) = state.transform else { continue };
            let place = match last {
                Some((same, place)) if same == transform => place,
                _ => self.add_move(&transform, origin),
            };
            last = Some((transform, place));
            self.words[entry] = place;
        }
        Some(start)
    }

    /// Appends a move about the asset's origin, as an instance's placement: offset, scale, quaternion. The sum of large
    /// numbers happens here, in f64.
    fn add_move(&mut self, transform: &PartTransform, origin: DVec3) -> u32 {
        let place = self.place();
        let offset = (transform.apply(origin) - origin).as_vec3().to_array();
        let rotation = transform.rotation().as_quat().to_array();
        let numbers = offset.into_iter().chain([transform.scale() as f32]).chain(rotation);
        self.words.extend(numbers.map(f32::to_bits));
        place
    }

    /// Appends a pose, about the asset's origin.
    fn add_pose(&mut self, pose: &SkinPose, origin: DVec3) -> u32 {
        let place = self.place();
        self.words.push(u32::try_from(pose.joints().len()).unwrap_or(0));
        for map in pose.joints() {
            let offset = map.transform_point3(origin) - origin;
            let rows = map.matrix3.transpose();
            for (row, offset) in [rows.x_axis, rows.y_axis, rows.z_axis].into_iter().zip(offset.to_array()) {
                self.words.extend(row.extend(offset).to_array().map(|x| (x as f32).to_bits()));
            }
        }
        place
    }

    fn place(&self) -> u32 {
        u32::try_from(self.words.len()).unwrap_or(u32::MAX)
    }

    /// Where the states of an instance begin, 0 without any; `None` if nothing of it is drawn.
    pub(crate) fn start(&self, instance: usize) -> Option<u32> {
        let listed = u32::try_from(instance).ok().and_then(|index| self.starts.get(&index));
        listed.copied().unwrap_or(self.others)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DQuat};

    use super::*;

    fn parts(parts: &[(u32, PartState)]) -> BTreeMap<u32, PartState> {
        parts.iter().copied().collect()
    }

    #[test]
    fn instances_find_their_states_and_hidden_ones_are_not_drawn() {
        let one = InstanceStates { others: PartState::default(), parts: parts(&[(2, PartState::HIDDEN)]) };
        let gone = InstanceStates { others: PartState::HIDDEN, parts: parts(&[(0, PartState::HIDDEN)]) };
        let alone = InstanceStates { others: PartState::HIDDEN, parts: parts(&[(1, PartState::default())]) };
        let instances = [(0, one), (3, gone), (4, alone)].into();
        let words = PartWords::new(&PartStates { instances, ..Default::default() }, DVec3::splat(1e6));
        let hidden = PartState::HIDDEN.word();
        assert_eq!(words.words, [0, 0, 0, 0, 3, 0, 0, 0, 0, 0, hidden, 2, 0, 0, hidden, hidden, 0]);
        assert_eq!([0, 1, 3, 4].map(|index| words.start(index)), [Some(4), Some(0), None, Some(11)]);
        let isolated = PartStates { others: PartState::HIDDEN, ..Default::default() };
        assert_eq!(PartWords::new(&isolated, DVec3::ZERO).start(9), None);
    }

    #[test]
    fn moves_are_about_the_origin_and_shared_by_neighbours() {
        let half_turn =
            PartTransform::new(DVec3::new(2.0, 0.0, 4e6), DQuat::from_rotation_y(std::f64::consts::PI), 2.0);
        let moved = PartState { transform: half_turn.ok(), ..Default::default() };
        let states =
            InstanceStates { parts: parts(&[(0, moved), (1, moved), (3, moved)]), ..Default::default() };
        let states = PartStates { instances: [(0, states)].into(), ..Default::default() };
        let origin = DVec3::new(0.0, 0.0, 1e6);
        let words = PartWords::new(&states, origin);
        // Header, five states, five places, the move.
        assert_eq!(words.words[4..12], [4, 12, 0, 0, 0, 0, 0, 0]);
        assert_eq!(words.words[12..17], [0, 17, 17, 0, 17]);
        assert_eq!(words.words.len(), 25);
        let numbers: Vec<f32> = words.words[17..25].iter().map(|word| f32::from_bits(*word)).collect();
        // z: 4e6 - 2 * 1e6 - 1e6.
        assert_eq!((numbers[0], numbers[1], numbers[2], numbers[3]), (2.0, 0.0, 1e6, 2.0));
        assert!((numbers[5].abs() - 1.0).abs() < 1e-6 && numbers[7].abs() < 1e-6, "{numbers:?}");
        // Another list behind it.
        let (mut both, end) = (words, 25);
        let appended = both.append(&states, origin);
        assert_eq!((both.start(0), appended.start(0)), (Some(4), Some(end)));
        assert_eq!(both.words[end as usize + 1], 12 + end - 4);
    }

    #[test]
    fn poses_are_about_the_origin_with_and_without_other_states() {
        let map = DAffine3::from_rotation_translation(
            DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2),
            DVec3::new(2e6, 1.0, 0.0),
        );
        let pose = || SkinPose::new([map, DAffine3::IDENTITY]);
        let mut states = PartStates { poses: [(0, pose()), (5, pose())].into(), ..Default::default() };
        let tinted = InstanceStates { parts: parts(&[(0, PartState::HIDDEN)]), ..Default::default() };
        states.instances.insert(5, tinted);
        let words = PartWords::new(&states, DVec3::new(1e6, 1e6, 0.0));
        let [first, second] = [0, 5].map(|index| words.start(index).unwrap() as usize);
        assert_eq!(words.words[first..first + 4], [0, 0, first as u32 + 4, 0]);
        assert_eq!(words.words[second + POSE] as usize, second + 5);
        let at = first + 4;
        assert_eq!(words.words[at], 2);
        let numbers: Vec<f32> =
            words.words[at + 1..at + 25].iter().map(|word| f32::from_bits(*word)).collect();
        // x: 2e6 - 1e6 - 1e6; y: 1 + 1e6 - 1e6.
        let near = |at: usize, value: f32| (numbers[at] - value).abs() < 1e-6;
        assert!(near(1, -1.0) && near(3, 0.0) && near(7, 1.0), "{numbers:?}");
        assert_eq!(numbers[12..], [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    }
}
