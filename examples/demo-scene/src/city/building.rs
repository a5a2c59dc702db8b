//! One building of a block's perimeter: storeys of windows and walls to street and court, a roof and what stands on it.
//!
//! Its origin is on the ground in the middle, with the street towards +z.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

use super::facade::{self, Opening, Ornament, Style};
use super::glb::{Glb, Index, Place};
use super::ledges;
use super::materials::{named, of_kind};
use super::part::Part;
use super::plan::{DEPTH, Lot};
use super::roof;
use crate::maths::{cos_turns, sin_turns};
use crate::noise::{hash, uniform};

/// Height of a ground floor.
const GROUND: f64 = 4.3;

/// A side of the building: turned from the street, `width` wide and `distance` from the middle.
#[derive(Clone, Copy, Debug)]
struct Side {
    name: &'static str,
    turns: f64,
    width: f64,
    distance: f64,
}

impl Side {
    /// A place on the side: x along it, y up, z outwards from its wall.
    fn place(self, at: DVec3) -> Place {
        let (sin, cos) = (sin_turns(self.turns), cos_turns(self.turns));
        let (x, z) = (at.x, at.z + self.distance);
        Place { at: DVec3::new(x * cos + z * sin, at.y, z * cos - x * sin), turns: self.turns }
    }
}

/// Everything that is decided about a building before its parts are made.
struct Plan {
    seed: u64,
    width: f64,
    storeys: usize,
    storey: f64,
    style: Style,
    /// The street's side first, then the court's, then ends that face another street.
    sides: Vec<Side>,
    has_shop: bool,
    pitch: Option<f64>,
    /// Whether windows of one size share a mesh. Otherwise each has its own, as exporters write them that know no
    /// instances.
    shares_meshes: bool,
}

impl Plan {
    fn of(lot: &Lot) -> Self {
        let r = |k: i64| uniform(lot.seed, k, 0, 0);
        let pick = |kind: &str, k: i64| {
            let all = of_kind(kind);
            all[(hash(lot.seed, k, 1, 0) % all.len() as u64) as usize]
        };
        let (wall, ornament) = match (r(1) * 10.0).floor() as usize {
            0..4 => (pick("plaster", 2), Ornament::Corniced),
            4 | 5 => (pick("ashlar", 2), Ornament::Corniced),
            6 | 7 => (pick("brick", 2), Ornament::Framed),
            _ => (pick("plaster", 2), Ornament::Plain),
        };
        let is_plain = ornament == Ornament::Plain;
        let base = if is_plain { named("concrete") } else { pick("ashlar", 3) };
        let roof = if r(4) < 0.6 { pick("tiles", 4) } else { named("slate") };
        let style = Style { wall, base, trim: pick("trim", 5), frame: pick("paint", 6), roof, ornament };
        let side = |name, turns: f64, width, distance| Side { name, turns, width, distance };
        let mut sides =
            vec![side("street", 0.0, lot.width, DEPTH * 0.5), side("court", 0.5, lot.width, DEPTH * 0.5)];
        for (end, turns) in [(0, 0.75), (1, 0.25)] {
            if lot.ends[end] {
                sides.push(side("end", turns, DEPTH, lot.width * 0.5));
            }
        }
        // Corner buildings have flat roofs: no gable towards the street.
        let is_corner = lot.ends[0] || lot.ends[1];
        let pitch = (!is_corner && r(7) < if is_plain { 0.4 } else { 0.9 }).then(|| 0.62 + 0.3 * r(8));
        Self {
            seed: lot.seed,
            width: lot.width,
            storeys: 4 + (r(9) * 2.99).floor() as usize,
            storey: if is_plain { 2.95 } else { 3.35 + 0.3 * r(10) },
            style,
            sides,
            has_shop: r(11) < 0.65,
            pitch,
            shares_meshes: r(12) < 0.3,
        }
    }

    fn random(&self, k: i64) -> f64 {
        uniform(self.seed, k, 2, 0)
    }

    /// Size of the windows of a storey.
    fn window_size(&self, storey: usize) -> [f64; 2] {
        let is_top = storey + 1 == self.storeys;
        match self.style.ornament {
            Ornament::Plain => [1.35, 1.45],
            _ if storey == 1 => [1.15, 2.15],
            _ if is_top => [1.05, 1.55],
            _ => [1.1, 1.9],
        }
    }
}

/// Adds the building of a lot below `parent`.
pub(super) fn add(glb: &mut Glb, parent: Index, lot: &Lot) {
    let plan = Plan::of(lot);
    let extras = format!(
        "\"address\":\"{}\",\"built\":{},\"storeys\":{}",
        lot.number,
        1870 + (plan.random(0) * 120.0).floor() as u32,
        plan.storeys
    );
    let place = Place { at: lot.at, turns: lot.turns };
    let node = glb.group(parent, format!("building {}", lot.number), place, extras);
    let mut building = Building { glb, plan: &plan, node, shared: BTreeMap::new() };
    let mut y = 0.0;
    for storey in 0..plan.storeys {
        let height = if storey == 0 { GROUND } else { plan.storey };
        building.storey(storey, y, height);
        y += height;
    }
    building.top(y);
}

struct Building<'a> {
    glb: &'a mut Glb,
    plan: &'a Plan,
    node: Index,
    shared: BTreeMap<String, Index>,
}

impl Building<'_> {
    fn part(&mut self, parent: Index, name: String, place: Place, extras: &str, make: impl FnOnce() -> Part) {
        let mesh = self.glb.mesh(&name, make);
        self.glb.part(parent, name, place, mesh, extras.to_owned());
    }

    /// A part that equal ones may share the mesh of; `kind` tells them apart.
    fn copy(&mut self, parent: Index, name: String, kind: String, place: Place, make: impl FnOnce() -> Part) {
        let extras = format!("\"type\":\"{kind}\"");
        if !self.plan.shares_meshes {
            return self.part(parent, name, place, &extras, make);
        }
        let mesh = match self.shared.get(&kind) {
            Some(&mesh) => mesh,
            None => self.glb.mesh(&kind, make),
        };
        self.shared.insert(kind, mesh);
        self.glb.part(parent, name, place, mesh, extras);
    }

    fn storey(&mut self, storey: usize, y: f64, height: f64) {
        let place = Place::at(DVec3::Y * y);
        let node = self.glb.group(self.node, format!("floor {storey}"), place, String::new());
        let mut window = 0;
        for (number, side) in self.plan.sides.iter().enumerate() {
            self.side(node, (storey, height), (number, *side), &mut window);
        }
    }

    fn side(
        &mut self,
        node: Index,
        (storey, height): (usize, f64),
        (number, side): (usize, Side),
        window: &mut usize,
    ) {
        let plan = self.plan;
        let style = plan.style;
        // The court is plainer than the street.
        let plain = Style { ornament: Ornament::Plain, ..style };
        let dressed = if side.name == "court" { plain } else { style };
        let axes = ((side.width - 0.8) / 2.55).floor().max(1.0) as usize;
        let spacing = side.width / axes as f64;
        let middle = |axis: usize| (axis as f64 + 0.5) * spacing - side.width * 0.5;
        let is_street_ground = storey == 0 && number == 0;
        let door_axis = if plan.random(1) < 0.5 { 0 } else { axes - 1 };
        let sill = if storey == 0 { 1.35 } else { 0.85 };
        let size = plan.window_size(storey);
        let bay_axis = (axes >= 3 && style.ornament == Ornament::Corniced && plan.random(2) < 0.4)
            .then_some(axes / 2)
            .filter(|_| number == 0 && storey > 0 && storey + 1 < plan.storeys);
        let has_balconies = side.name != "court" || style.ornament == Ornament::Plain;
        let mut openings = Vec::new();
        let shop = is_street_ground && plan.has_shop && axes > 1;
        for axis in 0..axes {
            let x = middle(axis);
            let at = |y: f64| side.place(DVec3::new(x, y, 0.0));
            if is_street_ground && axis == door_axis {
                let size = [1.3, 3.1];
                openings.push(Opening::new(x, 0.3, size));
                self.part(node, "door".to_owned(), at(0.3), "\"fire_rating\":\"EI30\"", || {
                    facade::door(&style, size)
                });
                self.part(node, "stairs".to_owned(), at(0.0), "", || facade::stairs(style.trim, 1.9, 2));
                continue;
            }
            if shop {
                continue;
            }
            if bay_axis == Some(axis) {
                self.copy(node, "bay window".to_owned(), "bay".to_owned(), at(0.0), || {
                    ledges::bay(&style, spacing.min(3.0) * 0.94, height)
                });
                continue;
            }
            let is_door =
                storey > 0 && has_balconies && plan.random(20 + 8 * storey as i64 + axis as i64) < 0.16;
            let (low, size) = if is_door { (0.12, [size[0], size[1] + sill - 0.12]) } else { (sill, size) };
            let size = [size[0], size[1].min(height - low - 0.55)];
            openings.push(Opening::new(x, low, size));
            *window += 1;
            let kind = format!("window {:.2} x {:.2} {:?}", size[0], size[1], dressed.ornament);
            self.copy(node, format!("window {window}"), kind, at(low), || {
                facade::window(&dressed, size, !is_door)
            });
            if is_door {
                let is_stone = style.ornament == Ornament::Corniced && side.name == "street";
                let width = (size[0] + 1.0).min(spacing * 0.96);
                self.copy(
                    node,
                    format!("balcony {window}"),
                    format!("balcony {width:.2} {is_stone}"),
                    at(low),
                    || ledges::balcony(&style, width, if is_stone { 0.8 } else { 1.1 }, is_stone),
                );
            }
        }
        if shop {
            self.shop(node, side, spacing, door_axis == 0, &mut openings);
        }
        openings.sort_by(|a, b| a.low.x.total_cmp(&b.low.x));
        let material = if storey == 0 { style.base } else { style.wall };
        let half = side.width * 0.5;
        let name = format!("{} wall", side.name);
        self.part(node, name, side.place(DVec3::ZERO), "\"load_bearing\":true", || {
            facade::wall(material, [-half, half], height, &openings)
        });
        let course = height - 0.24;
        if side.name != "court" && style.ornament != Ornament::Plain && storey + 1 < plan.storeys {
            self.part(node, format!("{} course", side.name), side.place(DVec3::Y * course), "", || {
                facade::string_course(style.trim, side.width)
            });
        }
    }

    /// A shop front over all axes but the door's, and perhaps an awning.
    fn shop(
        &mut self,
        node: Index,
        side: Side,
        spacing: f64,
        door_is_left: bool,
        openings: &mut Vec<Opening>,
    ) {
        let plan = self.plan;
        let style = plan.style;
        let width = side.width - spacing - 0.7;
        let x = if door_is_left { spacing * 0.5 } else { -spacing * 0.5 };
        let size = [width, 2.75];
        openings
            .push(Opening { low: DVec2::new(x - width * 0.5, 0.05), high: DVec2::new(x + width * 0.5, 2.8) });
        let place = |y: f64, z: f64| side.place(DVec3::new(x, y, z));
        self.part(node, "shop front".to_owned(), place(0.05, 0.0), "\"use\":\"retail\"", || {
            facade::shop_front(&style, size, plan.seed)
        });
        if plan.random(3) < 0.6 {
            let awnings = of_kind("awning");
            let material = awnings[(hash(plan.seed, 4, 4, 4) % awnings.len() as u64) as usize];
            self.part(node, "awning".to_owned(), place(2.86, 0.12), "", || facade::awning(material, width));
        }
    }

    /// Cornice, roof, and what belongs to them.
    fn top(&mut self, y: f64) {
        let (plan, node) = (self.plan, self.node);
        let style = plan.style;
        let width = plan.width;
        for side in plan.sides.iter().filter(|side| side.name != "court") {
            self.part(node, format!("{} cornice", side.name), side.place(DVec3::Y * (y - 0.42)), "", || {
                facade::cornice(&style, side.width)
            });
        }
        let pipe = Place::at(DVec3::new(width * 0.5 - 0.12, 0.0, DEPTH * 0.5));
        self.part(node, "drainpipe".to_owned(), pipe, "", || ledges::drainpipe(y - 0.4));
        for (name, x, turns) in [("left", -width * 0.5, 0.75), ("right", width * 0.5, 0.25)] {
            let is_open = plan.sides.iter().any(|side| side.turns == turns);
            if !is_open {
                let place = Place { at: DVec3::new(x, 0.0, 0.0), turns };
                let half = DEPTH * 0.5;
                self.part(node, format!("{name} party wall"), place, "\"fire_rating\":\"F90\"", || {
                    facade::wall(named("plaster grey"), [-half, half], y, &[])
                });
            }
        }
        let roof = Place::at(DVec3::Y * y);
        let node = self.glb.group(node, "roof", roof, String::new());
        let Some(pitch) = plan.pitch else {
            self.part(node, "flat roof".to_owned(), Place::default(), "", || {
                roof::flat(&style, width, DEPTH)
            });
            let at = DVec3::new((plan.random(5) - 0.5) * (width - 5.0), 0.08, -1.5);
            self.part(node, "plant".to_owned(), Place::at(at), "\"use\":\"ventilation\"", roof::plant);
            return;
        };
        self.part(node, "pitched roof".to_owned(), Place::default(), "", || {
            roof::pitched(&style, width, DEPTH, pitch)
        });
        for (name, x, turns) in [("left", -width * 0.5, 0.5), ("right", width * 0.5, 0.0)] {
            let place = Place { at: DVec3::X * x, turns };
            self.part(node, format!("{name} gable"), place, "", || {
                roof::gable(named("plaster grey"), DEPTH, pitch)
            });
        }
        let dormers = if plan.random(6) < 0.7 { (width / 3.2).floor() as usize } else { 0 };
        for dormer in 0..dormers {
            let x = ((dormer as f64 + 0.5) / dormers as f64 - 0.5) * width;
            let z = DEPTH * 0.5 - 1.0;
            let at = DVec3::new(x, pitch + 0.1, z);
            self.copy(node, format!("dormer {}", dormer + 1), "dormer".to_owned(), Place::at(at), || {
                roof::dormer(&style, pitch)
            });
        }
        for chimney in 0..1 + usize::from(plan.random(7) < 0.5) {
            let side = if chimney == 0 { 1.0 } else { -1.0 };
            let at = DVec3::new(side * (width * 0.5 - 1.4), pitch * (DEPTH * 0.5 - 1.2), -1.2);
            let pots = 2 + (plan.random(8) * 3.0).floor() as usize;
            self.part(node, format!("chimney {}", chimney + 1), Place::at(at), "", || roof::chimney(pots));
        }
    }
}
