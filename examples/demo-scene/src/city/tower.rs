//! A tower: storeys of glass between mullions, on a lobby, under a flat roof with machines.

use glam::DVec3;

use super::facade::{self, Ornament, Style};
use super::glb::{Glb, Index, Place};
use super::ledges;
use super::materials::named;
use super::plan::Lot;
use super::roof;
use crate::maths::{cos_turns, sin_turns};
use crate::noise::uniform;

/// Heights of the lobby and of a storey.
const LOBBY: f64 = 6.0;
const STOREY: f64 = 3.6;

/// Adds the tower of a lot below `parent`.
pub(super) fn add(glb: &mut Glb, parent: Index, lot: &Lot, storeys: usize) {
    let width = lot.width;
    let extras = format!("\"address\":\"{}\",\"storeys\":{storeys},\"use\":\"office\"", lot.number);
    let place = Place { at: lot.at, turns: lot.turns };
    let node = glb.group(parent, format!("tower {}", lot.number), place, extras);
    let is_light = uniform(lot.seed, 1, 0, 0) < 0.5;
    let shares_meshes = uniform(lot.seed, 2, 0, 0) < 0.5;
    let spandrel = named(if is_light { "trim pale" } else { "paint grey" });
    let bays = 6 + (uniform(lot.seed, 3, 0, 0) * 6.0).floor() as usize;
    let mut shared: Option<Index> = None;
    for storey in 0..=storeys {
        let y = if storey == 0 { 0.0 } else { LOBBY + STOREY * (storey - 1) as f64 };
        let height = if storey == 0 { LOBBY } else { STOREY };
        let floor = glb.group(node, format!("floor {storey}"), Place::at(DVec3::Y * y), String::new());
        for (side, turns) in [("south", 0.0), ("east", 0.25), ("north", 0.5), ("west", 0.75)] {
            let at = DVec3::new(sin_turns(turns), 0.0, cos_turns(turns)) * (width * 0.5);
            let make = || ledges::curtain_wall(spandrel, width, height, bays);
            let mesh = match shared.filter(|_| storey > 1 && shares_meshes) {
                Some(mesh) => mesh,
                None => glb.mesh("curtain wall", make),
            };
            if storey > 0 {
                shared = Some(mesh);
            }
            let extras = "\"u_value\":0.8".to_owned();
            glb.part(floor, format!("curtain wall {side}"), Place { at, turns }, mesh, extras);
        }
    }
    let top = glb.group(node, "roof", Place::at(DVec3::Y * (LOBBY + STOREY * storeys as f64)), String::new());
    let style = Style {
        wall: named("concrete"),
        base: named("concrete"),
        trim: named("zinc"),
        frame: named("steel"),
        roof: named("slate"),
        ornament: Ornament::Plain,
    };
    let mesh = glb.mesh("flat roof", || roof::flat(&style, width, width));
    glb.part(top, "flat roof", Place::default(), mesh, String::new());
    let mesh = glb.mesh("plant", roof::plant);
    for (number, x) in [(1, -6.0), (2, 0.0), (3, 6.0)] {
        let place = Place::at(DVec3::new(x, 0.08, 3.0 * (uniform(lot.seed, number, 4, 0) - 0.5)));
        glb.part(top, format!("plant {number}"), place, mesh, "\"use\":\"ventilation\"".to_owned());
    }
    let entrance = Style { trim: named("steel"), ..style };
    let mesh = glb.mesh("stairs", || facade::stairs(entrance.trim, 6.0, 1));
    glb.part(node, "stairs", Place::at(DVec3::Z * (width * 0.5)), mesh, String::new());
}
