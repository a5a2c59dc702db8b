//! Axes of a sweep: one value, a list of values, or a range of numbers.

use std::fmt;
use std::marker::PhantomData;

use serde::Deserialize;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserializer, Error, IntoDeserializer, MapAccess, SeqAccess, Visitor};

/// Most values of one range: a mistake in a step should not exhaust the memory.
const MAX_RANGE_VALUES: usize = 10_000;

/// Values: `v`, `[v, w, …]`, or `{ from, to, step }` or `{ from, to, factor }`, both ends included.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis<T>(pub(super) Vec<T>);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Range {
    from: f64,
    to: f64,
    step: Option<f64>,
    factor: Option<f64>,
}

impl Range {
    fn values(&self) -> Result<Vec<f64>, String> {
        let Self { from, to, .. } = *self;
        // Includes ends that binary steps miss by a rounding error.
        let last = to * (1.0 + 1e-9);
        let mut values = Vec::new();
        let mut add = |value: f64| {
            values.push(value.min(to));
            values.len() <= MAX_RANGE_VALUES
        };
        let fits = match (self.step, self.factor) {
            (Some(step), None) if step > 0.0 && from <= to => {
                (0..).map(|i| from + f64::from(i) * step).take_while(|v| *v <= last).all(&mut add)
            }
            (None, Some(factor)) if factor > 1.0 && from > 0.0 && from <= to => {
                (0..).map(|i| from * factor.powi(i)).take_while(|v| *v <= last).all(&mut add)
            }
            _ => {
                return Err(
                    "a range is { from, to, step } with a step above 0, or { from, to, factor } with \
                            a factor above 1 and from above 0; from must not be above to"
                        .into(),
                );
            }
        };
        if fits { Ok(values) } else { Err(format!("the range has more than {MAX_RANGE_VALUES} values")) }
    }
}

struct Values<T>(PhantomData<T>);

impl<T> Values<T> {
    fn one<'de, D: Deserializer<'de>>(value: D) -> Result<Axis<T>, D::Error>
    where
        T: Deserialize<'de>,
    {
        T::deserialize(value).map(|value| Axis(vec![value]))
    }
}

impl<'de, T: Deserialize<'de>> Visitor<'de> for Values<T> {
    type Value = Axis<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value, a list of values, or a range { from, to, step } or { from, to, factor }")
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Self::Value, E> {
        Self::one(value.into_deserializer())
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Self::Value, E> {
        Self::one(value.into_deserializer())
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Self::Value, E> {
        Self::one(value.into_deserializer())
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Self::Value, E> {
        Self::one(value.into_deserializer())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, values: A) -> Result<Self::Value, A::Error> {
        Vec::deserialize(SeqAccessDeserializer::new(values)).map(Axis)
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
        let values = Range::deserialize(MapAccessDeserializer::new(map))?.values().map_err(Error::custom)?;
        let number = |value: f64| {
            // Whole numbers below 2^53 are exact; others are left to the target type.
            if value.fract() == 0.0 && (0.0..9e15).contains(&value) {
                T::deserialize(IntoDeserializer::<A::Error>::into_deserializer(value as u64))
            } else {
                T::deserialize(value.into_deserializer())
            }
        };
        values.into_iter().map(number).collect::<Result<_, _>>().map(Axis)
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Axis<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Values(PhantomData))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Deserialize)]
    struct File<T> {
        axis: Axis<T>,
    }

    fn read<T: serde::de::DeserializeOwned>(value: &str) -> Result<Vec<T>, String> {
        toml::from_str::<File<T>>(&format!("axis = {value}"))
            .map(|f| f.axis.0)
            .map_err(|e| e.message().into())
    }

    #[test]
    fn values_lists_and_ranges() {
        assert_eq!(read::<u64>("5").unwrap(), [5]);
        assert_eq!(read::<f64>("[5, 0.5]").unwrap(), [5.0, 0.5]);
        assert_eq!(read::<String>("\"x\"").unwrap(), ["x"]);
        assert_eq!(
            read::<u64>("{ from = 1_000_000, to = 16e6, factor = 2 }").unwrap(),
            [1, 2, 4, 8, 16].map(|m| m * 1_000_000)
        );
        let tenths = read::<f64>("{ from = 0, to = 0.3, step = 0.1 }").unwrap();
        assert_eq!((tenths.len(), tenths[3]), (4, 0.3));
        assert_eq!(read::<u64>("{ from = 7, to = 7, step = 1 }").unwrap(), [7]);
    }

    #[test]
    fn invalid_axes_are_refused() {
        for bad in
            ["{ from = 1, to = 2 }", "{ from = 1, to = 2, step = 0 }", "{ from = 3, to = 2, step = 1 }"]
        {
            assert!(read::<u64>(bad).unwrap_err().contains("a range is"), "{bad}");
        }
        assert!(read::<u64>("{ from = 0, to = 1e9, step = 0.001 }").unwrap_err().contains("more than"));
        assert!(read::<u64>("{ from = 0, to = 1, step = 0.5 }").unwrap_err().contains("floating point"));
        assert!(read::<u64>("[1, -1]").is_err());
        assert!(read::<u64>("{ from = 0, to = 1, stride = 1 }").unwrap_err().contains("unknown field"));
    }
}
