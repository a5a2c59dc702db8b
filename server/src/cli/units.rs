//! Numbers with units on the command line.

/// A rate in bits per second; `None` is no limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Rate(pub(super) Option<u64>);

/// Parses `2Mbit`, `500kbit`, `1.5Gbit`, a plain number of bits per second, or `off`.
pub(super) fn parse_rate(text: &str) -> Result<Rate, String> {
    if text.eq_ignore_ascii_case("off") || text.eq_ignore_ascii_case("unlimited") {
        return Ok(Rate(None));
    }
    let expected = || format!("{text:?} is not a rate; write for example 2Mbit, 500kbit or off");
    let lower = text.to_ascii_lowercase();
    let number = lower.strip_suffix("/s").unwrap_or(&lower);
    let number = number.strip_suffix("bit").or_else(|| number.strip_suffix("bps")).unwrap_or(number);
    let value = scaled(number).ok_or_else(expected)?;
    if value < 1000 {
        return Err(format!("{text:?} is below 1 kbit/s, the lowest rate supported"));
    }
    Ok(Rate(Some(value)))
}

/// Parses a size in bytes: `40000`, `40kB`, `1.5MB`.
pub(super) fn parse_size(text: &str) -> Result<u64, String> {
    let lower = text.to_ascii_lowercase();
    let number = lower.strip_suffix('b').unwrap_or(&lower);
    scaled(number).ok_or_else(|| format!("{text:?} is not a size; write for example 40000 or 40kB"))
}

/// Parses a decimal number with an optional factor `k` (10³), `m` (10⁶) or `g` (10⁹).
fn scaled(text: &str) -> Option<u64> {
    let (number, factor) = match text.as_bytes().last()? {
        b'k' => (&text[..text.len() - 1], 1e3),
        b'm' => (&text[..text.len() - 1], 1e6),
        b'g' => (&text[..text.len() - 1], 1e9),
        _ => (text, 1.0),
    };
    let plain = number.bytes().all(|b| b.is_ascii_digit() || b == b'.');
    let value = number.trim().parse::<f64>().ok().filter(|_| plain)? * factor;
    (value.is_finite() && value < 1e18).then_some(value.round() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_read() {
        assert_eq!(parse_rate("2Mbit"), Ok(Rate(Some(2_000_000))));
        assert_eq!(parse_rate("500kbit/s"), Ok(Rate(Some(500_000))));
        assert_eq!(parse_rate("1.5Gbps"), Ok(Rate(Some(1_500_000_000))));
        assert_eq!(parse_rate("8000"), Ok(Rate(Some(8000))));
        assert_eq!(parse_rate("off"), Ok(Rate(None)));
        for bad in ["", "x", "-2Mbit", "nan", "1e400", "2Tbit", "0", "99", "inf", "Mbit"] {
            assert!(parse_rate(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn sizes_are_read() {
        assert_eq!(parse_size("40000"), Ok(40_000));
        assert_eq!(parse_size("1.5MB"), Ok(1_500_000));
        assert!(parse_size("-1").is_err() && parse_size("").is_err() && parse_size("b").is_err());
    }
}
