//! Number types with a range, for settings, and the error of values outside it.

use lodestream_geometry::UnknownName;

/// A value outside a setting's range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{possible}; {given} is not")]
pub struct InvalidValue {
    possible: String,
    given: String,
}

impl InvalidValue {
    /// Error for the value `given`; `possible` is the first half of the message ("4 to 24 bits are possible").
    #[must_use]
    pub fn new(possible: impl Into<String>, given: impl Into<String>) -> Self {
        Self { possible: possible.into(), given: given.into() }
    }
}

impl From<UnknownName> for InvalidValue {
    fn from(unknown: UnknownName) -> Self {
        Self::new(format!("{} is possible", unknown.possible), format!("{:?}", unknown.given))
    }
}

/// A number type with one range: both ends included, or from the first to just below the second.
#[macro_export]
macro_rules! setting {
    ($(#[$about:meta])* $name:ident($number:ty), $range:expr, $unit:literal) => {
        $crate::setting! { @number $(#[$about])* $name($number), $unit }

        impl $name {
            /// Allowed range, both ends included.
            pub const RANGE: std::ops::RangeInclusive<$number> = $range;

            fn possible() -> String {
                format!("{} to {}", Self::RANGE.start(), Self::RANGE.end())
            }
        }
    };
    ($(#[$about:meta])* $name:ident($number:ty), below $range:expr, $unit:literal) => {
        $crate::setting! { @number $(#[$about])* $name($number), $unit }

        impl $name {
            /// Allowed range, without its end.
            pub const RANGE: std::ops::Range<$number> = $range;

            fn possible() -> String {
                format!("{} to below {}", Self::RANGE.start, Self::RANGE.end)
            }
        }
    };
    (@number $(#[$about:meta])* $name:ident($number:ty), $unit:literal) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
        pub struct $name($number);

        impl $name {
            /// The number.
            #[must_use]
            pub const fn get(self) -> $number {
                self.0
            }

            fn refusal(given: impl Into<String>) -> $crate::setting::InvalidValue {
                let possible = format!("{} {} are possible", Self::possible(), $unit);
                $crate::setting::InvalidValue::new(possible, given)
            }
        }

        impl TryFrom<$number> for $name {
            type Error = $crate::setting::InvalidValue;

            fn try_from(number: $number) -> Result<Self, $crate::setting::InvalidValue> {
                // NaN is in no range.
                if Self::RANGE.contains(&number) { Ok(Self(number)) } else { Err(Self::refusal(number.to_string())) }
            }
        }

        impl std::str::FromStr for $name {
            type Err = $crate::setting::InvalidValue;

            fn from_str(text: &str) -> Result<Self, $crate::setting::InvalidValue> {
                text.parse().map_err(|_| Self::refusal(format!("{text:?}"))).and_then(|n: $number| Self::try_from(n))
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                self.0.fmt(f)
            }
        }
    };
}
