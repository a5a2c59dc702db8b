//! One keyframe track: a property of a node over time, by the formulas of glTF 2.0, appendix C.

use glam::{DQuat, DVec4};

use crate::encoding::encode_variants;

/// What a channel animates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Property {
    /// Three numbers.
    Translation,
    /// A quaternion x, y, z, w.
    Rotation,
    /// Three numbers.
    Scale,
}

encode_variants!(Property { 0 => Translation, 1 => Rotation, 2 => Scale });

impl Property {
    /// Numbers of a value.
    #[must_use]
    pub const fn components(self) -> usize {
        match self {
            Self::Translation | Self::Scale => 3,
            Self::Rotation => 4,
        }
    }
}

/// How values between keyframes follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// Straight; of rotations, along the shorter great arc at constant speed.
    Linear,
    /// The value of the keyframe before.
    Step,
    /// Cubic Hermite splines; each keyframe has an incoming tangent, a value and an outgoing tangent.
    CubicSpline,
}

encode_variants!(Interpolation { 0 => Linear, 1 => Step, 2 => CubicSpline });

/// A keyframe track.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Number of the node.
    pub node: u32,
    /// What it animates.
    pub property: Property,
    /// Between keyframes.
    pub interpolation: Interpolation,
    /// Number of the times of its keyframes.
    pub timeline: u32,
    /// Values of its keyframes, one after the other.
    pub values: Vec<f32>,
}

/// Angle between quaternions below which they are interpolated straight, in radians: the difference is below rounding.
const STRAIGHT: f64 = 1e-6;

impl Channel {
    /// How many numbers so many keyframes have.
    #[must_use]
    pub const fn values_for(&self, keyframes: usize) -> usize {
        keyframes.saturating_mul(self.property.components()).saturating_mul(self.per_keyframe())
    }

    const fn per_keyframe(&self) -> usize {
        match self.interpolation {
            Interpolation::Linear | Interpolation::Step => 1,
            Interpolation::CubicSpline => 3,
        }
    }

    /// A value of a keyframe; of a spline, `which` is 0 for the incoming tangent, 1 for the value, 2 for the outgoing one.
    fn value(&self, keyframe: usize, which: usize) -> DVec4 {
        let (components, per) = (self.property.components(), self.per_keyframe());
        let start = (keyframe * per + which.min(per - 1)) * components;
        let mut value = [0.0; 4];
        for (to, from) in value.iter_mut().zip(self.values.get(start..start + components).unwrap_or_default())
        {
            *to = f64::from(*from);
        }
        DVec4::from_array(value)
    }

    /// The value at a time, of which the last number is 0 unless it is a rotation, which is of unit length. Before the
    /// first keyframe it is that one's, behind the last that one's.
    #[must_use]
    pub fn at(&self, times: &[f32], time_s: f64) -> DVec4 {
        let next = times.partition_point(|&time| f64::from(time) <= time_s);
        let last = times.len().saturating_sub(1);
        let (from, to) = (next.saturating_sub(1), next.min(last));
        let (begins, ends) = (times.get(from), times.get(to));
        let value = match (begins, ends) {
            (Some(&begins), Some(&ends)) if begins < ends && self.interpolation != Interpolation::Step => {
                let duration = f64::from(ends) - f64::from(begins);
                let share = (time_s - f64::from(begins)) / duration;
                self.between([from, to], share, duration)
            }
            _ => self.value(from, 1),
        };
        if self.property == Property::Rotation { unit(value).into() } else { value }
    }

    fn between(&self, [from, to]: [usize; 2], s: f64, duration: f64) -> DVec4 {
        let (start, end) = (self.value(from, 1), self.value(to, 1));
        match (self.interpolation, self.property) {
            (Interpolation::CubicSpline, _) => {
                let (leaves, arrives) = (self.value(from, 2) * duration, self.value(to, 0) * duration);
                let (s2, s3) = (s * s, s * s * s);
                start * (2.0 * s3 - 3.0 * s2 + 1.0)
                    + leaves * (s3 - 2.0 * s2 + s)
                    + end * (3.0 * s2 - 2.0 * s3)
                    + arrives * (s3 - s2)
            }
            (_, Property::Rotation) => slerp(unit(start).into(), unit(end).into(), s),
            _ => start + (end - start) * s,
        }
    }
}

/// A quaternion of unit length; the identity for one without a direction.
pub(super) fn unit(q: DVec4) -> DQuat {
    let length = q.length();
    if length > 0.0 && length.is_finite() { DQuat::from_vec4(q / length) } else { DQuat::IDENTITY }
}

/// Spherical linear interpolation along the shorter arc (Shoemake, "Animating rotation with quaternion curves", 1985).
fn slerp(a: DVec4, b: DVec4, s: f64) -> DVec4 {
    let b = if a.dot(b) < 0.0 { -b } else { b };
    // Exact for small angles too, where the arc cosine is not.
    let angle = 2.0 * (a - b).length().atan2((a + b).length());
    if angle < STRAIGHT {
        return a + (b - a) * s;
    }
    (a * ((1.0 - s) * angle).sin() + b * (s * angle).sin()) / angle.sin()
}
