//! Encoding of a page of punctual lights.
//!
//! Positions are integers on a grid around the first light, delta-coded. Neighbours on a page are neighbours in the
//! world, so a delta takes about two bytes per axis.

use super::numbers::{
    Input, long_angle, long_direction, long_float, power_of_two, put_signed, short_angle, short_direction,
    short_float,
};
use super::{
    INTENSITIES, MAX_COORDINATE, PUNCTUAL_LIGHTS_PER_PAGE, PunctualLight, PunctualLightsError, RANGES, Spot,
};

const VERSION: u8 = 1;
/// Steps of the grid per smallest range.
const STEPS_PER_RANGE: f64 = 1024.0;
/// Most steps from the first light; larger extents have larger steps.
const MAX_STEPS: f64 = 1_099_511_627_776.0;
/// Longest page: all lights with all fields.
pub const MAX_PAGE_BYTES: u32 = 32 + PUNCTUAL_LIGHTS_PER_PAGE * (1 + 3 * 9 + 5 + 2 + 8);
/// Fewest bytes of a light: flags and a byte per axis.
const LEAST_BYTES: usize = 4;

const SPOT: u8 = 1;
const SAME_LIGHT: u8 = 2;
const SAME_RANGE: u8 = 4;
const SAME_CONE: u8 = 8;

/// Fields that a light may share with the one before it on its page.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Shared {
    /// Components in 1/255 of the brightest, and the brightest.
    light: Option<([u8; 3], u16)>,
    range: Option<u16>,
    /// Direction, and inner and outer angle.
    cone: Option<([u16; 2], [u16; 2])>,
}

impl Shared {
    fn of(punctual_light: &PunctualLight) -> Self {
        let brightest = punctual_light.brightest();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "shares of the largest")]
        let part = |x: f32| (x / brightest * 255.0 + 0.5) as u8;
        let cone = |spot: Spot| {
            (short_direction(spot.direction), [spot.inner, spot.outer.max(1e-4)].map(short_angle))
        };
        Self {
            light: Some((punctual_light.intensity.map(part), short_float(brightest))),
            range: Some(short_float(punctual_light.range)),
            cone: punctual_light.spot.map(cone),
        }
    }
}

/// Encodes a page of 1 to [`PUNCTUAL_LIGHTS_PER_PAGE`] lights.
///
/// # Errors
/// If there are fewer or more, or [`PunctualLight::check`] fails for one.
pub fn encode_page(punctual_lights: &[PunctualLight]) -> Result<Vec<u8>, PunctualLightsError> {
    let Some(first) =
        punctual_lights.first().filter(|_| punctual_lights.len() <= PUNCTUAL_LIGHTS_PER_PAGE as usize)
    else {
        return Err(PunctualLightsError::WrongCount {
            got: punctual_lights.len() as u64,
            expected: PUNCTUAL_LIGHTS_PER_PAGE,
        });
    };
    punctual_lights.iter().try_for_each(PunctualLight::check)?;
    let origin = first.position;
    let exponent = exponent(punctual_lights, origin);
    let step = power_of_two(exponent);
    let mut out = vec![VERSION, exponent.cast_unsigned()];
    origin.iter().for_each(|x| out.extend(x.to_le_bytes()));
    #[expect(clippy::cast_possible_truncation, reason = "at most 64")]
    out.push(punctual_lights.len() as u8);
    let (mut before, mut at) = (Shared::default(), [0_i64; 3]);
    for punctual_light in punctual_lights {
        let Shared { light, range, cone } = Shared::of(punctual_light);
        let flags = [
            (cone.is_some(), SPOT),
            (light == before.light, SAME_LIGHT),
            (range == before.range, SAME_RANGE),
            (cone.is_some() && cone == before.cone, SAME_CONE),
        ];
        let flags = flags.iter().filter(|(set, _)| *set).fold(0, |all, (_, flag)| all | flag);
        out.push(flags);
        for axis in 0..3 {
            #[expect(clippy::cast_possible_truncation, reason = "at most 2^41 steps")]
            let steps = ((punctual_light.position[axis] - origin[axis]) / step).round() as i64;
            put_signed(steps - at[axis], &mut out);
            at[axis] = steps;
        }
        if let (Some((color, brightest)), 0) = (light, flags & SAME_LIGHT) {
            out.extend(color);
            out.extend(brightest.to_le_bytes());
        }
        if let (Some(range), 0) = (range, flags & SAME_RANGE) {
            out.extend(range.to_le_bytes());
        }
        if let (Some((direction, angles)), 0) = (cone, flags & SAME_CONE) {
            direction.iter().chain(&angles).for_each(|x| out.extend(x.to_le_bytes()));
        }
        before = Shared { light, range, cone: cone.or(before.cone) };
    }
    Ok(out)
}

/// Exponent of the grid's step, a power of two: fine enough for the smallest range, with coordinates of at most 42
/// bits.
fn exponent(punctual_lights: &[PunctualLight], origin: [f64; 3]) -> i8 {
    let range =
        punctual_lights.iter().map(|punctual_light| punctual_light.range).fold(f32::INFINITY, f32::min);
    let offsets = punctual_lights
        .iter()
        .flat_map(|punctual_light| (0..3).map(|axis| (punctual_light.position[axis] - origin[axis]).abs()));
    let extent = offsets.fold(0.0, f64::max);
    let step = (f64::from(range) / STEPS_PER_RANGE).max(extent / MAX_STEPS);
    // The exponent of a positive number is its logarithm, rounded down.
    let exponent = (step.to_bits() >> 52).cast_signed() - 1023;
    i8::try_from(exponent).unwrap_or(i8::MAX)
}

/// Decodes a page that must hold `count` lights. Memory is bounded by the length of `bytes`.
///
/// # Errors
/// If the bytes are not such a page.
pub fn decode_page(bytes: &[u8], count: u32) -> Result<Vec<PunctualLight>, PunctualLightsError> {
    let mut input = Input(bytes);
    let version = input.u8()?;
    if version != VERSION {
        return Err(PunctualLightsError::Version(version));
    }
    let exponent = input.u8()?.cast_signed();
    let mut origin = [0.0; 3];
    for x in &mut origin {
        *x = f64::from_le_bytes(input.bytes()?);
    }
    let step = power_of_two(exponent);
    let got = input.u8()?;
    if u32::from(got) != count || count > PUNCTUAL_LIGHTS_PER_PAGE {
        return Err(PunctualLightsError::WrongCount { got: got.into(), expected: count });
    }
    let mut punctual_lights = Vec::with_capacity(usize::from(got).min(input.0.len() / LEAST_BYTES));
    let (mut before, mut at) = (Shared::default(), [0_i64; 3]);
    for _ in 0..got {
        let flags = input.u8()?;
        let is = |flag| flags & flag != 0;
        if flags & !(SPOT | SAME_LIGHT | SAME_RANGE | SAME_CONE) != 0 || (is(SAME_CONE) && !is(SPOT)) {
            return Err(PunctualLightsError::Flags(flags));
        }
        for steps in &mut at {
            *steps = steps.checked_add(input.signed()?).ok_or(PunctualLightsError::Position)?;
        }
        if !is(SAME_LIGHT) {
            before.light = Some((input.bytes()?, input.u16()?));
        }
        if !is(SAME_RANGE) {
            before.range = Some(input.u16()?);
        }
        if is(SPOT) && !is(SAME_CONE) {
            before.cone = Some(([input.u16()?, input.u16()?], [input.u16()?, input.u16()?]));
        }
        punctual_lights.push(punctual_light(
            flags,
            before,
            [0, 1, 2].map(|axis| place(origin[axis], at[axis], step)),
        )?);
    }
    if input.0.is_empty() {
        Ok(punctual_lights)
    } else {
        Err(PunctualLightsError::TrailingBytes(input.0.len()))
    }
}

/// Coordinate of a light on one axis; NaN beyond 2⁵³ steps.
fn place(origin: f64, steps: i64, step: f64) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "inexact counts give NaN")]
    let offset = steps as f64 * step;
    if steps.unsigned_abs() <= 1 << 53 { origin + offset } else { f64::NAN }
}

/// Assembles a light from its fields.
fn punctual_light(
    flags: u8,
    fields: Shared,
    position: [f64; 3],
) -> Result<PunctualLight, PunctualLightsError> {
    let (Some((color, brightest)), Some(range)) = (fields.light, fields.range) else {
        return Err(PunctualLightsError::Flags(flags));
    };
    // Rounding may have moved a value slightly beyond its bound.
    if !position.iter().all(|x| x.abs() <= 1.001 * MAX_COORDINATE) {
        return Err(PunctualLightsError::Position);
    }
    let position = position.map(|x: f64| x.clamp(-MAX_COORDINATE, MAX_COORDINATE));
    let within = |short, [least, most]: [f32; 2]| {
        let x = long_float(short);
        (0.99 * least..=1.01 * most).contains(&x).then(|| x.clamp(least, most))
    };
    let Some(brightest) = within(brightest, INTENSITIES).filter(|_| color.contains(&255)) else {
        return Err(PunctualLightsError::Intensity);
    };
    let range = within(range, RANGES).ok_or(PunctualLightsError::Range)?;
    let spot = match (flags & SPOT != 0, fields.cone) {
        (false, _) => None,
        (true, None) => return Err(PunctualLightsError::Flags(flags)),
        (true, Some((direction, [inner, outer]))) => {
            if inner > outer || outer == 0 {
                return Err(PunctualLightsError::Cone);
            }
            let (inner, outer) = (long_angle(inner), long_angle(outer));
            Some(Spot { direction: long_direction(direction), inner, outer })
        }
    };
    let intensity = color.map(|c| f32::from(c) / 255.0 * brightest);
    Ok(PunctualLight { position, intensity, range, spot })
}
