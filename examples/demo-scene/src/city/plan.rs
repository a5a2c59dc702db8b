//! The street grid, its blocks and their lots.
//!
//! Streets cross at multiples of the pitch. Lots are taken by their distance from the start view, so a city of any size
//! is seen from the same place and grows outwards.

use glam::{DVec2, DVec3};

use super::street::{CARRIAGEWAY, KERB, PAVEMENT};
use crate::maths::{cos_turns, sin_turns};
use crate::noise::{hash, uniform};

/// Depth of a building, from street to court.
pub(super) const DEPTH: f64 = 12.0;
/// Sides of the land of a block within its pavements.
pub(super) const BLOCK: [f64; 2] = [84.0, 60.0];
/// Distance between streets.
pub(super) const PITCH: [f64; 2] =
    [BLOCK[0] + 2.0 * PAVEMENT + CARRIAGEWAY, BLOCK[1] + 2.0 * PAVEMENT + CARRIAGEWAY];
/// Where the start view looks: in the middle of a street.
const FOCUS: DVec2 = DVec2::new(0.0, -34.0);

/// What stands on a lot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Use {
    /// A building of the perimeter.
    House,
    /// A tower of a number of storeys.
    Tower(usize),
}

/// A piece of a block.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Lot {
    /// Column and row of its block.
    pub(super) block: [i64; 2],
    /// From 1, within the block.
    pub(super) number: usize,
    /// The middle of its building, relative to the block's middle.
    pub(super) at: DVec3,
    /// Towards the street: 0 is +z, 0.25 +x.
    pub(super) turns: f64,
    pub(super) width: f64,
    /// Whether its left and right end face another street.
    pub(super) ends: [bool; 2],
    pub(super) what: Use,
    pub(super) seed: u64,
}

impl Lot {
    /// A place relative to the block's middle of a place relative to the lot's street edge: x along it, z into the
    /// street.
    pub(super) fn frontage(&self, at: DVec3) -> DVec3 {
        let (sin, cos) = (sin_turns(self.turns), cos_turns(self.turns));
        let (x, z) = (at.x, at.z + DEPTH * 0.5);
        self.at * DVec3::new(1.0, 0.0, 1.0) + DVec3::new(x * cos + z * sin, at.y, z * cos - x * sin)
    }
}

/// The middle of a block.
pub(super) fn middle([column, row]: [i64; 2]) -> DVec3 {
    DVec3::new((column as f64 + 0.5) * PITCH[0], 0.0, (row as f64 + 0.5) * PITCH[1])
}

/// The lots of all blocks within `reach` columns and rows, the nearest to the start view first.
pub(super) fn lots(seed: u64, reach: i64) -> Vec<Lot> {
    let blocks = (-reach..reach).flat_map(|column| (-reach..reach).map(move |row| [column, row]));
    let mut all: Vec<(f64, Lot)> = blocks
        .flat_map(|block| of_block(seed, block))
        .map(|lot| {
            let at = middle(lot.block) + lot.at;
            ((DVec2::new(at.x, at.z) - FOCUS).length(), lot)
        })
        .collect();
    all.sort_by(|(a, one), (b, other)| {
        a.total_cmp(b).then_with(|| (one.block, one.number).cmp(&(other.block, other.number)))
    });
    all.into_iter().map(|(_, lot)| lot).collect()
}

/// The lots of a block: houses around a court, or two towers on a square.
fn of_block(seed: u64, block: [i64; 2]) -> Vec<Lot> {
    let own = |k: i64| hash(seed ^ 0xC17, block[0], block[1], k);
    let lot = |number: usize, x: f64, z: f64, turns: f64, width: f64, ends: [bool; 2]| Lot {
        block,
        number,
        at: DVec3::new(x, KERB, z),
        turns,
        width,
        ends,
        what: Use::House,
        seed: own(number as i64),
    };
    // Around the start view are houses, with towers behind them.
    let is_near = (-1..1).contains(&block[0]) && (-2..1).contains(&block[1]);
    if !is_near && own(0).is_multiple_of(7) {
        let storeys = |k: i64| 12 + (own(k) % 14) as usize;
        return [(1, -23.0), (2, 23.0)]
            .map(|(number, x)| {
                let tower = lot(number, x, 0.0, 0.0, 26.0, [true; 2]);
                Lot { what: Use::Tower(storeys(number as i64 + 50)), ..tower }
            })
            .to_vec();
    }
    let mut lots = Vec::new();
    for turns in [0.0, 0.25, 0.5, 0.75] {
        let is_long = turns == 0.0 || turns == 0.5;
        // The long sides have the corners.
        let length = if is_long { BLOCK[0] } else { BLOCK[1] - 2.0 * DEPTH };
        let distance = if is_long { BLOCK[1] } else { BLOCK[0] } * 0.5 - DEPTH * 0.5;
        let count = (length / 11.5).round().max(1.0) as usize;
        let weights: Vec<f64> =
            (0..count).map(|i| 0.8 + 0.5 * uniform(own(9), i as i64, (turns * 4.0) as i64, 0)).collect();
        let sum: f64 = weights.iter().sum();
        let mut from = -length * 0.5;
        for (i, weight) in weights.iter().enumerate() {
            let width = length * weight / sum;
            let along = from + width * 0.5;
            from += width;
            let (sin, cos) = (sin_turns(turns), cos_turns(turns));
            let (x, z) = (along * cos + distance * sin, distance * cos - along * sin);
            let ends = [is_long && i == 0, is_long && i + 1 == count];
            lots.push(lot(lots.len() + 1, x, z, turns, width, ends));
        }
    }
    lots
}
