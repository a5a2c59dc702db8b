//! Unit vectors as two integers: the octahedral map (Meyer, Süßmuth, Sußner, Stamminger and Greiner,
//! "On floating-point normal vectors", EGSR 2010; Cigolle et al., "A survey of efficient
//! representations for independent unit vectors", JCGT 2014).

use crate::mesh::NORMAL_BITS;

/// Largest coordinate; even, so that the six axis directions are exact.
const TOP: f64 = ((1_u32 << NORMAL_BITS) - 2) as f64;

/// Encodes the direction of a vector; a zero vector as +z.
///
/// Error: at most 0.24° with 10 bits per axis. Only + − × ÷, so identical on all machines.
#[must_use]
pub fn encode(v: [f64; 3]) -> [u16; 2] {
    let size = v[0].abs() + v[1].abs() + v[2].abs();
    if !(size > 0.0 && size.is_finite()) {
        return encode([0.0, 0.0, 1.0]);
    }
    let (x, y) = (v[0] / size, v[1] / size);
    let (x, y) = if v[2] < 0.0 { ((1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)) } else { (x, y) };
    [x, y].map(|c| ((c * 0.5 + 0.5) * TOP + 0.5).floor().clamp(0.0, TOP) as u16)
}

/// Decodes to a unit vector. Coordinates out of range are clamped.
#[must_use]
pub fn decode(q: [u16; 2]) -> [f64; 3] {
    let [x, y] = q.map(|c| f64::from(c).min(TOP) / TOP * 2.0 - 1.0);
    let z = 1.0 - x.abs() - y.abs();
    let (x, y) = if z < 0.0 { ((1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)) } else { (x, y) };
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

fn sign(x: f64) -> f64 {
    if x < 0.0 { -1.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn directions_come_back_within_a_quarter_of_a_degree() {
        let mut random = Random::new(3);
        let mut worst = 1.0_f64;
        for _ in 0..100_000 {
            let v = [0; 3].map(|_| random.unit() * 2.0 - 1.0);
            let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
            if length < 0.1 {
                continue;
            }
            let w = decode(encode(v));
            worst = worst.min((v[0] * w[0] + v[1] * w[1] + v[2] * w[2]) / length);
        }
        assert!(worst > 0.25_f64.to_radians().cos(), "{}", worst.acos().to_degrees());
    }

    #[test]
    fn axes_are_exact_and_no_result_is_nan() {
        for axis in 0..3 {
            for s in [-1.0, 1.0] {
                let mut v = [0.0; 3];
                v[axis] = s;
                assert_eq!(decode(encode(v)), v);
            }
        }
        assert_eq!(encode([f64::NAN; 3]), encode([0.0, 0.0, 1.0]));
        assert!(decode([u16::MAX; 2]).iter().all(|x| x.is_finite()));
    }
}
