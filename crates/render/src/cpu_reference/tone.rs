//! Tone curve: `tonemap.wgsl`.

/// Fit of the ACES filmic curve (Narkowicz, "ACES filmic tone mapping curve", 2016).
#[must_use]
pub fn filmic(x: f64) -> f64 {
    ((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)).clamp(0.0, 1.0)
}

/// Khronos' neutral curve ("PBR neutral tone mapper", 2024).
#[must_use]
pub fn neutral(given: [f64; 3]) -> [f64; 3] {
    let start = 0.8 - 0.04;
    let least = given.into_iter().fold(f64::INFINITY, f64::min);
    let offset = if least < 0.08 { least - 6.25 * least * least } else { 0.04 };
    let colour = given.map(|x| x - offset);
    let peak = colour.into_iter().fold(0.0, f64::max);
    if peak < start {
        return colour;
    }
    let room = 1.0 - start;
    let compressed = 1.0 - room * room / (peak + room - start);
    let white = 1.0 - 1.0 / (0.15 * (peak - compressed) + 1.0);
    colour.map(|x| x * compressed / peak * (1.0 - white) + compressed * white)
}

/// Linear value to sRGB, both in 0..=1 (IEC 61966-2-1).
#[must_use]
pub fn encode_srgb(x: f64) -> f64 {
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// sRGB value to linear.
#[must_use]
pub fn decode_srgb(x: f64) -> f64 {
    if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curve_rises_from_black_to_white() {
        assert_eq!(filmic(0.0), 0.0);
        let mut last = 0.0;
        for i in 1..=400 {
            let y = filmic(f64::from(i) * 0.02);
            assert!(y >= last && y <= 1.0);
            last = y;
        }
        assert!(filmic(100.0) > 0.99);
        // Middle grey stays in the middle of the range of display values.
        assert!((0.3..0.6).contains(&encode_srgb(filmic(0.18))));
    }

    #[test]
    fn srgb_inverts() {
        for i in 0..=255 {
            let x = f64::from(i) / 255.0;
            assert!((encode_srgb(decode_srgb(x)) - x).abs() < 1e-6);
        }
    }
}
