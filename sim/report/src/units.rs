//! Formats values for readers, in few digits.

/// At most three significant digits, without trailing zeros.
pub(crate) fn plain(value: f64) -> String {
    let magnitude = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
    let decimals = (2 - magnitude).clamp(0, 9) as usize;
    let text = format!("{value:.decimals$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

/// A time in milliseconds, as "250 ms", "1.5 s" or "20 min".
pub(super) fn milliseconds(ms: f64) -> String {
    match ms {
        ms if ms < 1000.0 => format!("{} ms", plain(ms)),
        ms if ms < 600_000.0 => format!("{} s", plain(ms / 1e3)),
        ms => format!("{} min", plain(ms / 6e4)),
    }
}

/// Bytes, as "950 B", "19.1 kB" or "2 MB", a kB being a thousand bytes.
pub(super) fn bytes(bytes: f64) -> String {
    match bytes {
        bytes if bytes < 1e3 => format!("{} B", plain(bytes)),
        bytes if bytes < 1e6 => format!("{} kB", plain(bytes / 1e3)),
        bytes if bytes < 1e9 => format!("{} MB", plain(bytes / 1e6)),
        bytes => format!("{} GB", plain(bytes / 1e9)),
    }
}

/// Bits per second, as "2 Mbit/s".
pub(super) fn rate(bits_per_s: u64) -> String {
    format!("{} Mbit/s", megabits(bits_per_s as f64))
}

/// Bits per second in millions.
pub(super) fn megabits(bits_per_s: f64) -> String {
    plain(bits_per_s / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_digits_are_enough() {
        let cases = [(0.0, "0"), (0.98712, "0.987"), (12.34, "12.3"), (999.4, "999"), (1e4, "10000")];
        for (value, text) in cases {
            assert_eq!(plain(value), text);
        }
        assert_eq!(
            ["178.6", "2500", "90000", "1200000"].map(|ms| milliseconds(ms.parse().unwrap())),
            ["179 ms", "2.5 s", "90 s", "20 min"]
        );
        assert_eq!([999.0, 19_098.0, 2e6, 3.2e9].map(bytes), ["999 B", "19.1 kB", "2 MB", "3.2 GB"]);
        assert_eq!((rate(1_900_000), megabits(16e6)), ("1.9 Mbit/s".to_owned(), "16".to_owned()));
    }
}
