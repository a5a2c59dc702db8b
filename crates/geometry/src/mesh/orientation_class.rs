//! Orientation classes of normals: which axes a normal is close to. Distinguishes the flat sides of axis-aligned
//! geometry.

use crate::mesh::vec3::{Vec3, add, dot, triangle_normal};
use crate::mesh::{QuantisedMesh, Wedge};
use crate::numbers::id32;

/// Number of classes; [`orientation_class`] is below this.
pub(crate) const ORIENTATION_CLASSES: u32 = 26;

/// The class of a normal of any length: positive, negative or neither for each axis. An axis counts if the normal's
/// component is more than 0.39 of its length; normals along one axis may deviate by 23°.
pub(crate) fn orientation_class(normal: Vec3) -> u32 {
    let least = 0.15 * dot(normal, normal);
    let number = (0..3).rev().fold(0, |number, axis| {
        let part = normal[axis];
        number * 3 + if part * part <= least { 0 } else { 1 + u32::from(part < 0.0) }
    });
    // A normal close to no axis is zero.
    number.saturating_sub(1)
}

/// Sign for each axis, by class.
const SIGNS: [[i8; 3]; ORIENTATION_CLASSES as usize] = {
    let mut ways = [[0; 3]; ORIENTATION_CLASSES as usize];
    let mut orientation_class = 0;
    while orientation_class < ways.len() {
        let number = orientation_class + 1;
        let digits = [number % 3, number / 3 % 3, number / 9];
        let mut axis = 0;
        while axis < 3 {
            ways[orientation_class][axis] = [0, 1, -1][digits[axis]];
            axis += 1;
        }
        orientation_class += 1;
    }
    ways
};

/// Sign of a class for each axis: 1, −1, or 0. Copies have their originals' signs.
pub(crate) fn signs_of(orientation_class: u32) -> [i8; 3] {
    SIGNS[(orientation_class % ORIENTATION_CLASSES) as usize]
}

/// Whether a class is close to one axis only.
pub(crate) fn has_one_axis(orientation_class: u32) -> bool {
    signs_of(orientation_class).iter().filter(|&&way| way != 0).count() == 1
}

impl QuantisedMesh {
    /// Renumbers the normal groups of each vertex by the orientation classes of their faces, so that
    /// [`Codec::AxisAligned`](crate::Codec::AxisAligned) can predict the groups of a face's corners. Group numbers
    /// only distinguish groups within a vertex, so nothing else changes. A mesh with one group per vertex stays as it
    /// is.
    ///
    /// Cost: a pass over the faces and a sort of the wedges; 28 bytes per wedge temporarily.
    pub(crate) fn renumber_groups_by_orientation(&mut self) {
        if self.wedges.iter().all(|wedge| wedge.attributes.group == 0) {
            return;
        }
        let mut sums = vec![[0.0; 3]; self.wedges.len()];
        for face in &self.faces {
            let place = |w: u32| self.positions[self.wedges[w as usize].vertex as usize].map(f64::from);
            let [a, b, c] = face.wedges.map(place);
            let normal = triangle_normal(a, b, c);
            for wedge in face.wedges {
                let sum: &mut Vec3 = &mut sums[wedge as usize];
                *sum = add(*sum, normal);
            }
        }
        let key = |wedges: &[Wedge], w: u32| (wedges[w as usize].vertex, wedges[w as usize].attributes.group);
        let mut order: Vec<u32> = (0..id32(self.wedges.len())).collect();
        order.sort_unstable_by_key(|&w| (key(&self.wedges, w), w));
        let mut at = 0;
        while let Some(&first) = order.get(at) {
            let vertex = self.wedges[first as usize].vertex;
            let mut copies = [0_u32; ORIENTATION_CLASSES as usize];
            while let Some((of, group)) =
                order.get(at).map(|&w| key(&self.wedges, w)).filter(|k| k.0 == vertex)
            {
                let count = order[at..].iter().take_while(|&&w| key(&self.wedges, w) == (of, group)).count();
                let members = &order[at..at + count];
                let side =
                    orientation_class(members.iter().fold([0.0; 3], |sum, &w| add(sum, sums[w as usize])));
                let copy = &mut copies[side as usize];
                let number = side + ORIENTATION_CLASSES * *copy;
                *copy += 1;
                members.iter().for_each(|&w| self.wedges[w as usize].attributes.group = number);
                at += count;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use super::*;
    use crate::common::{quantised, shapes};
    use crate::mesh::normals::wedge_normals;

    #[test]
    fn classes_are_distinct_and_recover_their_signs() {
        let mut seen = BTreeSet::new();
        for ways in
            (0..27).map(|i: i32| [1, 3, 9].map(|place| i / place % 3 - 1)).filter(|ways| *ways != [0; 3])
        {
            // Slightly rotated, of any length.
            let normal = [0, 1, 2].map(|k| 700.0 * (f64::from(ways[k]) + 0.2 * f64::from(ways[(k + 1) % 3])));
            let number = orientation_class(normal);
            assert!(number < ORIENTATION_CLASSES && seen.insert(number), "{ways:?}: {number}");
            assert_eq!(signs_of(number).map(i32::from), ways);
            assert_eq!(signs_of(number + 3 * ORIENTATION_CLASSES).map(i32::from), ways, "a copy");
            assert_eq!(has_one_axis(number), ways.iter().filter(|&&way| way != 0).count() == 1);
        }
        assert!(orientation_class([0.0; 3]) < ORIENTATION_CLASSES);
    }

    #[test]
    fn numbered_groups_are_the_same_groups() {
        for source in [shapes::stones(20), shapes::frigate(4), shapes::torus(12, 18)] {
            let before = quantised(&source);
            let mut after = before.clone();
            after.renumber_groups_by_orientation();
            let mut names = BTreeMap::new();
            for (a, b) in before.wedges.iter().zip(&after.wedges) {
                let group = (a.vertex, a.attributes.group);
                assert_eq!(*names.entry(group).or_insert(b.attributes.group), b.attributes.group);
                assert_eq!((a.attributes.uv, a.attributes.normal), (b.attributes.uv, b.attributes.normal));
            }
            let distinct: BTreeSet<_> = names.iter().map(|(group, name)| (group.0, *name)).collect();
            assert_eq!(distinct.len(), names.len());
            assert_eq!(wedge_normals(&before), wedge_normals(&after));
        }
    }

    #[test]
    fn a_box_corner_has_its_three_classes() {
        let mut mesh = quantised(&shapes::stones(1));
        mesh.renumber_groups_by_orientation();
        let normals = wedge_normals(&mesh);
        for (wedge, normal) in mesh.wedges.iter().zip(normals) {
            assert_eq!(wedge.attributes.group, orientation_class(normal));
        }
    }
}
