//! Filters: inverse transforms of attributes, applied in place after decoding.
//!
//! Computed in single precision with correctly rounded square roots (IEEE 754), so that every machine gives the same
//! bytes.

/// Transform that the encoder applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Filter {
    /// Unit vectors as points of an octahedron; in 4 × 8 or 4 × 16 bits; the last component is unchanged.
    Octahedral,
    /// Unit quaternions without their largest component; 4 × 16 bits.
    Quaternion,
    /// Single precision as a mantissa of 24 bits and an exponent of 8.
    Exponential,
    /// Colours as luma and two chromas, with opacity; in 4 × 8 or 4 × 16 bits.
    Color,
}

impl Filter {
    /// Whether the filter applies to elements of this many bytes.
    pub(super) fn fits(self, stride: usize) -> bool {
        match self {
            Self::Octahedral | Self::Color => stride == 4 || stride == 8,
            Self::Quaternion => stride == 8,
            Self::Exponential => stride.is_multiple_of(4),
        }
    }

    /// Applies the inverse transform. `stride` must fit.
    pub(super) fn undo(self, bytes: &mut [u8], stride: usize) {
        let whole = stride == 8;
        match self {
            Self::Octahedral if whole => {
                each(bytes, |v| octahedral(v.map(i16::from_le_bytes)).map(i16::to_le_bytes))
            }
            Self::Octahedral => each(bytes, |v| octahedral(v.map(i8::from_le_bytes)).map(i8::to_le_bytes)),
            Self::Quaternion => each(bytes, |v| quaternion(v.map(i16::from_le_bytes)).map(i16::to_le_bytes)),
            Self::Exponential => each(bytes, |[v]| [exponential(u32::from_le_bytes(v)).to_le_bytes()]),
            Self::Color if whole => each(bytes, |v| {
                let signed = v.map(|v| i32::from(i16::from_le_bytes(v)));
                color(v.map(|v| i32::from(u16::from_le_bytes(v))), signed, 65_535.0)
                    .map(|v| (v as u16).to_le_bytes())
            }),
            Self::Color => each(bytes, |v: [[u8; 1]; 4]| {
                let signed = v.map(|v| i32::from(i8::from_le_bytes(v)));
                color(v.map(|v| i32::from(u8::from_le_bytes(v))), signed, 255.0)
                    .map(|v| (v as u8).to_le_bytes())
            }),
        }
    }
}

/// Applies a function to all elements of `N` components of `W` bytes.
fn each<const N: usize, const W: usize>(bytes: &mut [u8], change: impl Fn([[u8; W]; N]) -> [[u8; W]; N]) {
    for element in bytes.chunks_exact_mut(N * W) {
        let mut components = [[0; W]; N];
        components.as_flattened_mut().copy_from_slice(element);
        element.copy_from_slice(change(components).as_flattened());
    }
}

/// Integer type of components.
trait Signed: Copy + Into<f32> {
    const MOST: f32;
    /// Truncates to the type's bits.
    fn of(value: i32) -> Self;
}

impl Signed for i8 {
    const MOST: f32 = 127.0;

    fn of(value: i32) -> Self {
        value as Self
    }
}

impl Signed for i16 {
    const MOST: f32 = 32_767.0;

    fn of(value: i32) -> Self {
        value as Self
    }
}

/// Rounds to the nearest integer, halves away from zero; NaN, which a zero vector gives, becomes 0.
fn rounded(value: f32) -> i32 {
    (value + if value >= 0.0 { 0.5 } else { -0.5 }) as i32
}

/// Decodes a unit vector. The third component is the fixed-point value of 1 in the first two.
fn octahedral<T: Signed>([x, y, one, kept]: [T; 4]) -> [T; 4] {
    let (x, y, one): (f32, f32, f32) = (x.into(), y.into(), one.into());
    let z = one - x.abs() - y.abs();
    // The lower half is folded over the edges of the upper.
    let fold = z.min(0.0);
    let x = if x >= 0.0 { x + fold } else { x - fold };
    let y = if y >= 0.0 { y + fold } else { y - fold };
    let scale = T::MOST / (x * x + y * y + z * z).sqrt();
    let [x, y, z] = [x, y, z].map(|v| T::of(rounded(v * scale)));
    [x, y, z, kept]
}

/// Decodes a quaternion. The last component's lowest two bits number the omitted component; its other bits are the
/// fixed-point value of 1/√2.
fn quaternion([x, y, z, scale_and_index]: [i16; 4]) -> [i16; 4] {
    let one = f32::from(scale_and_index | 3);
    let [x, y, z] = [x, y, z].map(f32::from);
    let square = one * one * 2.0 - x * x - y * y - z * z;
    let w = square.max(0.0).sqrt();
    let scale = 32_767.0 / 2_f32.sqrt() / one;
    let largest = (scale_and_index & 3) as usize;
    let mut turned = [0; 4];
    for (value, place) in [w, x, y, z].into_iter().zip(largest..) {
        turned[place % 4] = rounded(value * scale) as i16;
    }
    turned
}

fn exponential(value: u32) -> f32 {
    let (mantissa, exponent) = ((value << 8) as i32 >> 8, value as i32 >> 24);
    let value = f32::from_bits((exponent.wrapping_add(127) as u32) << 23) * mantissa as f32;
    // An exponent of −128, which no encoder writes, gives NaN, whose bits differ between processors.
    if value.is_nan() { f32::NAN } else { value }
}

/// Decodes a colour to components of 0 to `most`.
fn color([luma, _, _, opacity]: [i32; 4], [_, orange, green, _]: [i32; 4], most: f32) -> [i32; 4] {
    // Opacity has one bit less than the other components; its highest set bit gives their number of bits.
    let one = [1, 2, 4, 8].into_iter().fold(opacity, |bits, shift| bits | bits >> shift);
    let alpha = (opacity << 1 & one) | (opacity & 1);
    let scale = most / one as f32;
    let [red, blue] = [luma + orange - green, luma - orange - green];
    [red, luma + green, blue, alpha].map(|v| (v as f32 * scale + 0.5) as i32)
}
