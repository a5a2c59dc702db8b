//! Skins: which joints move a vertex, and how much (linear blend skinning; Magnenat-Thalmann, Laperrière and Thalmann,
//! "Joint-dependent local deformations", 1988).

/// Joints that may move one vertex.
pub const MAX_INFLUENCES: usize = 4;
/// Joints of a mesh.
pub const MAX_JOINTS: usize = 256;
/// Sum of a vertex's weights.
pub const WHOLE: u8 = u8::MAX;

/// The joints that move a vertex, with their weights.
///
/// Joints ascend; those of weight 0 stand last and are 0. The weights' sum is [`WHOLE`], so that a weight is off by at
/// most half a 255th for two joints, a 255th for more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Skin {
    joints: [u8; MAX_INFLUENCES],
    weights: [u8; MAX_INFLUENCES],
}

impl Default for Skin {
    fn default() -> Self {
        Self { joints: [0; MAX_INFLUENCES], weights: [WHOLE, 0, 0, 0] }
    }
}

impl Skin {
    /// The skin of joints with weights of any sum; a joint may occur twice. The four largest count. Weights that are not
    /// positive numbers are none; without any, the default (joint 0 alone).
    #[must_use]
    pub fn new(influences: impl IntoIterator<Item = (u8, f64)>) -> Self {
        let mut sums: Vec<(u8, f64)> = Vec::new();
        for (joint, weight) in
            influences.into_iter().filter(|(_, weight)| *weight > 0.0 && weight.is_finite())
        {
            match sums.iter_mut().find(|sum| sum.0 == joint) {
                Some(sum) => sum.1 += weight,
                None => sums.push((joint, weight)),
            }
        }
        sums.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        sums.truncate(MAX_INFLUENCES);
        let total: f64 = sums.iter().map(|sum| sum.1).sum();
        let exact = |weight: f64| weight / total * f64::from(WHOLE);
        let floor = |weight: f64| exact(weight) as u8;
        let mut rounded: Vec<(u8, u8, f64)> = sums
            .iter()
            .map(|&(joint, weight)| (joint, floor(weight), exact(weight) - f64::from(floor(weight))))
            .collect();
        // The largest remainders are rounded up, so that the sum is whole.
        let missing = u32::from(WHOLE).saturating_sub(rounded.iter().map(|r| u32::from(r.1)).sum());
        rounded.sort_by(|a, b| b.2.total_cmp(&a.2).then(a.0.cmp(&b.0)));
        for (_, weight, _) in rounded.iter_mut().take(missing as usize) {
            *weight += 1;
        }
        Self::of(rounded.into_iter().map(|(joint, weight, _)| (joint, weight))).unwrap_or_default()
    }

    /// The skin of at most four distinct joints whose weights have the sum [`WHOLE`]; else `None`.
    #[must_use]
    pub fn of(influences: impl IntoIterator<Item = (u8, u8)>) -> Option<Self> {
        let mut skin = Self { joints: [0; MAX_INFLUENCES], weights: [0; MAX_INFLUENCES] };
        let given = influences.into_iter().filter(|influence| influence.1 > 0);
        for (count, (joint, weight)) in given.enumerate() {
            if count == MAX_INFLUENCES {
                return None;
            }
            // Insertion in order of the joints.
            let mut at = count;
            while at > 0 && skin.joints[at - 1] >= joint {
                if skin.joints[at - 1] == joint {
                    return None;
                }
                (skin.joints[at], skin.weights[at]) = (skin.joints[at - 1], skin.weights[at - 1]);
                at -= 1;
            }
            (skin.joints[at], skin.weights[at]) = (joint, weight);
        }
        let sum: u32 = skin.weights.iter().map(|&weight| u32::from(weight)).sum();
        (sum == u32::from(WHOLE)).then_some(skin)
    }

    /// Its joints with their weights, which are not 0.
    pub fn influences(self) -> impl Iterator<Item = (u8, u8)> {
        self.joints.into_iter().zip(self.weights).filter(|influence| influence.1 > 0)
    }

    /// Joints, for a renderer.
    #[must_use]
    pub fn joints(self) -> [u8; MAX_INFLUENCES] {
        self.joints
    }

    /// Weights of the joints.
    #[must_use]
    pub fn weights(self) -> [u8; MAX_INFLUENCES] {
        self.weights
    }

    /// One more than its largest joint.
    #[must_use]
    pub fn joint_count(self) -> usize {
        self.influences().map(|(joint, _)| usize::from(joint) + 1).max().unwrap_or(0)
    }
}

/// Where each joint takes the mesh in one pose: affine maps, as rows.
pub type Pose = Vec<[[f64; 4]; 3]>;

/// The point to which a map takes a point.
pub(crate) fn mapped(map: &[[f64; 4]; 3], [x, y, z]: [f64; 3]) -> [f64; 3] {
    map.map(|[a, b, c, d]| a * x + b * y + c * z + d)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_have_a_whole_sum_and_keep_the_largest_four() {
        let skin = Skin::new([(9, 0.1), (3, 0.3), (7, 0.3), (200, 0.05), (4, 0.3), (3, 0.0)]);
        assert_eq!(skin.joints(), [3, 4, 7, 9]);
        let [a, b, c, d] = skin.weights();
        assert_eq!(u32::from(a) + u32::from(b) + u32::from(c) + u32::from(d), 255);
        for (weight, exact) in skin.weights().into_iter().zip([0.3, 0.3, 0.3, 0.1]) {
            assert!((f64::from(weight) / 255.0 - exact).abs() <= 1.0 / 255.0);
        }
    }

    #[test]
    fn a_joint_that_occurs_twice_counts_once_and_bad_weights_are_left_out() {
        assert_eq!(Skin::new([(5, 0.25), (2, f64::NAN), (5, 0.75), (1, -1.0)]), Skin::new([(5, 1.0)]));
        assert_eq!(Skin::new([]), Skin::default());
        assert_eq!(Skin::new([(5, 1.0), (6, 1e-9)]), Skin::new([(5, 1.0)]));
    }

    #[test]
    fn skins_that_are_not_in_their_one_form_do_not_exist() {
        assert!(Skin::of([(1, 100), (2, 155)]) == Skin::of([(2, 155), (1, 100), (7, 0)]));
        for bad in [vec![(1, 254)], vec![(1, 255), (2, 1)], vec![(1, 100), (1, 155)], vec![]] {
            assert_eq!(Skin::of(bad.clone()), None, "{bad:?}");
        }
        assert_eq!(Skin::of((0..5).map(|joint| (joint, 51))), None);
    }
}
