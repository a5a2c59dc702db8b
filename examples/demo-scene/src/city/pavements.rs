//! The file of the streets: carriageways, pavements, courts, and furniture that is placed many times.

use std::collections::BTreeSet;

use glam::DVec3;

use super::glb::{Glb, Index, Place};
use super::materials::{named, of_kind};
use super::plan::DEPTH;
use super::plan::{BLOCK, Lot, PITCH, Use, middle};
use super::street::{self, CARRIAGEWAY, KERB, PAVEMENT};
use crate::noise::{hash, uniform};

/// What is placed many times: a mesh each.
struct Catalogue {
    lamp: Index,
    bench: Index,
    trees: Vec<Index>,
    cars: Vec<Index>,
    crossing: Index,
}

/// The streets in the making.
pub(super) struct Streets {
    pub(super) glb: Glb,
    catalogue: Catalogue,
    seed: u64,
    blocks: BTreeSet<[i64; 2]>,
    crossroads: BTreeSet<[i64; 2]>,
    /// Carriageways by the crossroads at their least coordinates, and whether they run along x.
    segments: BTreeSet<([i64; 2], bool)>,
}

impl Streets {
    /// Streets that consist of nothing yet.
    pub(super) fn new(mut glb: Glb, seed: u64) -> Self {
        let leaves = of_kind("leaves");
        let trees = (0..4)
            .map(|i| {
                glb.mesh(&format!("tree {i}"), || {
                    street::tree(seed ^ (0x7EE + i as u64), leaves[i % leaves.len()], 9)
                })
            })
            .collect();
        let cars = of_kind("car")
            .into_iter()
            .enumerate()
            .map(|(i, paint)| glb.mesh(&format!("car {i}"), || street::car(paint, i % 2 == 1)))
            .collect();
        let catalogue = Catalogue {
            lamp: glb.mesh("lamp", street::lamp),
            bench: glb.mesh("bench", street::bench),
            trees,
            cars,
            crossing: glb.mesh("crossing", street::crossing),
        };
        let (blocks, crossroads, segments) = Default::default();
        Self { glb, catalogue, seed, blocks, crossroads, segments }
    }

    fn own(&mut self, parent: Index, name: &str, place: Place, make: impl FnOnce() -> super::part::Part) {
        let mesh = self.glb.mesh(name, make);
        self.glb.part(parent, name, place, mesh, String::new());
    }

    /// What belongs to a lot: its pavement and what stands on it; with the first lot of a block, the streets around it.
    pub(super) fn add(&mut self, lot: &Lot) {
        if self.blocks.insert(lot.block) {
            self.block(lot);
        }
        if lot.what != Use::House {
            return;
        }
        let r = |k: i64| uniform(lot.seed, k, 5, 0);
        let [column, row] = lot.block;
        let place = Place::at(middle(lot.block));
        let name = format!("block {column} {row} / front {}", lot.number);
        let node = self.glb.group(0, name, place, String::new());
        let at = |x: f64, y: f64, z: f64, turns: f64| Place {
            at: lot.frontage(DVec3::new(x, y, z)),
            turns: lot.turns + turns,
        };
        self.own(node, "pavement", at(0.0, 0.0, PAVEMENT * 0.5, 0.0), || street::pavement(lot.width));
        for (end, side) in [(0, -1.0), (1, 1.0)] {
            if lot.ends[end] {
                let x = side * 0.5 * (lot.width + PAVEMENT);
                self.own(node, "end pavement", at(x, 0.0, -0.5 * DEPTH, 0.25 * side), || {
                    street::pavement(DEPTH)
                });
            }
        }
        let has_tree = r(1) < 0.6;
        let (trees, cars) = (&self.catalogue.trees, &self.catalogue.cars);
        let pick = |from: &[Index], k: i64| from[(hash(lot.seed, k, 6, 0) % from.len() as u64) as usize];
        if has_tree {
            let extras = "\"species\":\"Tilia cordata\"".to_owned();
            let x = lot.width * (r(2) - 0.5) * 0.5;
            self.glb.part(node, "tree", at(x, KERB, PAVEMENT - 0.9, r(3)), pick(trees, 1), extras);
        }
        if !has_tree || r(4) < 0.4 {
            let x = lot.width * 0.5 - 0.8;
            self.glb.part(node, "lamp", at(x, KERB, PAVEMENT - 0.6, 0.0), self.catalogue.lamp, String::new());
        }
        if r(5) < 0.2 {
            let place = at(-lot.width * 0.3, KERB, PAVEMENT - 1.1, 0.5);
            self.glb.part(node, "bench", place, self.catalogue.bench, String::new());
        }
        let bays = (lot.width / 5.2).floor() as i64;
        for bay in 0..bays {
            // None at the corners, where the crossings are.
            let is_corner = (lot.ends[0] && bay == 0) || (lot.ends[1] && bay + 1 == bays);
            if r(10 + bay) < 0.62 && !is_corner {
                let x = ((bay as f64 + 0.5) / bays as f64 - 0.5) * lot.width + 0.3 * (r(20 + bay) - 0.5);
                let turn = if r(30 + bay) < 0.8 { 0.0 } else { 0.5 };
                let place = at(x, 0.0, PAVEMENT + 1.05, turn);
                self.glb.part(node, "car", place, pick(cars, 40 + bay), String::new());
            }
        }
    }

    /// The streets around a block, as far as they are not there yet; its corners and its court.
    fn block(&mut self, lot: &Lot) {
        let [column, row] = lot.block;
        let node = self.glb.group(
            0,
            format!("block {column} {row}"),
            Place::at(middle(lot.block)),
            "\"district\":\"centre\"".to_owned(),
        );
        if lot.what == Use::House {
            let size = [BLOCK[0] - 2.0 * DEPTH, BLOCK[1] - 2.0 * DEPTH];
            let lift = Place::at(DVec3::Y * KERB);
            self.own(node, "court", lift, || street::ground(named("lawn"), size, 12.0));
            for tree in 0..5 {
                let r = |k: i64| uniform(lot.seed, k, tree, 7);
                let at = DVec3::new((r(0) - 0.5) * (size[0] - 8.0), KERB, (r(1) - 0.5) * (size[1] - 8.0));
                let mesh = self.catalogue.trees[(tree % 4) as usize];
                self.glb.part(node, "tree", Place { at, turns: r(2) }, mesh, String::new());
            }
        } else {
            let size = [BLOCK[0] + 2.0 * PAVEMENT, BLOCK[1] + 2.0 * PAVEMENT];
            self.own(node, "square", Place::at(DVec3::Y * KERB), || {
                street::ground(named("paving"), size, 12.0)
            });
        }
        if lot.what == Use::House {
            for (x, z) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
                let corner = DVec3::new(x * (BLOCK[0] + PAVEMENT), 0.0, z * (BLOCK[1] + PAVEMENT)) * 0.5;
                self.own(node, "corner", Place::at(corner), street::corner);
            }
        }
        for (dx, dz) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            self.crossroads([column + dx, row + dz]);
        }
        for (at, along_x) in [
            ([column, row], true),
            ([column, row + 1], true),
            ([column, row], false),
            ([column + 1, row], false),
        ] {
            self.segment(at, along_x);
        }
    }

    fn crossroads(&mut self, at: [i64; 2]) {
        if self.crossroads.insert(at) {
            let place = Place::at(DVec3::new(at[0] as f64 * PITCH[0], 0.0, at[1] as f64 * PITCH[1]));
            self.own(0, &format!("crossroads {} {}", at[0], at[1]), place, || {
                street::ground(named("asphalt"), [CARRIAGEWAY; 2], CARRIAGEWAY)
            });
        }
    }

    fn segment(&mut self, at: [i64; 2], along_x: bool) {
        if !self.segments.insert((at, along_x)) {
            return;
        }
        let length = PITCH[usize::from(!along_x)] - CARRIAGEWAY;
        let (dx, dz) = if along_x { (0.5, 0.0) } else { (0.0, 0.5) };
        let middle = DVec3::new((at[0] as f64 + dx) * PITCH[0], 0.0, (at[1] as f64 + dz) * PITCH[1]);
        let place = Place { at: middle, turns: if along_x { 0.25 } else { 0.0 } };
        let name = format!("street {} {} {}", at[0], at[1], if along_x { "east" } else { "south" });
        let extras =
            format!("\"surface\":\"asphalt\",\"year\":{}", 1990 + hash(self.seed, at[0], at[1], 8) % 30);
        let node = self.glb.group(0, name, place, extras);
        self.own(node, "carriageway", Place::default(), || {
            street::ground(named("asphalt"), [CARRIAGEWAY, length], 24.0)
        });
        self.own(node, "dashes", Place::default(), || street::dashes(length - 12.0));
        for side in [-1.0, 1.0] {
            let place = Place::at(DVec3::Z * (side * (length * 0.5 - PAVEMENT - 0.2)));
            self.glb.part(node, "crossing", place, self.catalogue.crossing, String::new());
        }
    }
}
