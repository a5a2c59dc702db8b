//! Which axis of a model points up. In scenes it is y.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use glam::{DQuat, DVec3};

/// Extension of models whose axis z points up by custom: those of printers and machine tools.
const Z_UP: &str = "stl";

/// An axis, in its direction or against it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UpAxis {
    /// The axis x.
    X,
    /// The axis y.
    #[default]
    Y,
    /// The axis z.
    Z,
    /// Against the axis x.
    MinusX,
    /// Against the axis y.
    MinusY,
    /// Against the axis z.
    MinusZ,
}

impl UpAxis {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::X, Self::Y, Self::Z, Self::MinusX, Self::MinusY, Self::MinusZ];

    /// The usual axis of a model file's format: z for STL, y for others.
    #[must_use]
    pub fn of_file(file: &Path) -> Self {
        let is_z_up = file.extension().is_some_and(|own| own.eq_ignore_ascii_case(Z_UP));
        if is_z_up { Self::Z } else { Self::Y }
    }

    /// Its name: `x`, `-x` and so on.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
            Self::MinusX => "-x",
            Self::MinusY => "-y",
            Self::MinusZ => "-z",
        }
    }

    /// The rotation that turns the axis to y: by a right angle about z or x, or by two about x.
    #[must_use]
    pub fn turn(self) -> DQuat {
        let right = std::f64::consts::FRAC_PI_2;
        match self {
            Self::Y => DQuat::IDENTITY,
            Self::X => DQuat::from_axis_angle(DVec3::Z, right),
            Self::MinusX => DQuat::from_axis_angle(DVec3::Z, -right),
            Self::Z => DQuat::from_axis_angle(DVec3::X, -right),
            Self::MinusZ => DQuat::from_axis_angle(DVec3::X, right),
            Self::MinusY => DQuat::from_axis_angle(DVec3::X, 2.0 * right),
        }
    }
}

impl fmt::Display for UpAxis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for UpAxis {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let named = Self::ALL.into_iter().find(|axis| axis.name() == text);
        named.ok_or_else(|| "write x, y, z, -x, -y or -z".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_axis_is_turned_up() {
        for axis in UpAxis::ALL {
            let unit = match axis.name().trim_start_matches('-') {
                "x" => DVec3::X,
                "y" => DVec3::Y,
                _ => DVec3::Z,
            };
            let of_axis = if axis.name().starts_with('-') { -unit } else { unit };
            assert!((axis.turn() * of_axis - DVec3::Y).length() < 1e-15, "{axis}");
            assert_eq!(axis.name().parse(), Ok(axis));
        }
        assert!("w".parse::<UpAxis>().is_err());
        assert_eq!(UpAxis::of_file(Path::new("a/b.STL")), UpAxis::Z);
        assert_eq!(UpAxis::of_file(Path::new("b.obj")), UpAxis::Y);
    }
}
