//! The mesh of one part: flat faces, boxes, mouldings, turned and rounded solids, each with a material of the city.
//!
//! Parts of a facade have x along the wall (to the right, seen from outside), y up and z outwards. Metres.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

use super::materials::{self, Material};
use crate::maths::{cos_turns, sin_turns, unit_or};
use crate::mesh::box_map;
use crate::noise::value3;

/// The faces of one material.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Surface {
    pub(super) positions: Vec<DVec3>,
    pub(super) normals: Vec<DVec3>,
    pub(super) uvs: Vec<DVec2>,
    pub(super) faces: Vec<[u16; 3]>,
}

/// The mesh of a part: a surface for each material that it uses.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Part {
    pub(super) surfaces: BTreeMap<Material, Surface>,
}

impl Part {
    pub(super) fn faces(&self) -> usize {
        self.surfaces.values().map(|surface| surface.faces.len()).sum()
    }

    fn vertex(&mut self, material: Material, at: DVec3, normal: DVec3) -> u16 {
        let tile = materials::tile(material);
        let surface = self.surfaces.entry(material).or_default();
        surface.positions.push(at);
        surface.normals.push(normal);
        surface.uvs.push(box_map(at, normal) / tile);
        (surface.positions.len() - 1) as u16
    }

    fn face(&mut self, material: Material, face: [u16; 3]) {
        self.surfaces.entry(material).or_default().faces.push(face);
    }

    /// A flat convex polygon, counter-clockwise seen from outside.
    pub(super) fn polygon(&mut self, material: Material, corners: &[DVec3]) {
        let mut normal = DVec3::ZERO;
        for pair in corners.windows(2).skip(1) {
            normal += (pair[0] - corners[0]).cross(pair[1] - corners[0]);
        }
        let normal = unit_or(normal, DVec3::Y);
        let ids: Vec<u16> = corners.iter().map(|&at| self.vertex(material, at, normal)).collect();
        for pair in ids.windows(2).skip(1) {
            self.face(material, [ids[0], pair[0], pair[1]]);
        }
    }

    /// A rectangle of a wall at depth `z`, facing outwards; nothing if it has no area.
    pub(super) fn panel(&mut self, material: Material, low: DVec2, high: DVec2, z: f64) {
        if high.x - low.x > 1e-6 && high.y - low.y > 1e-6 {
            let at = |x: f64, y: f64| DVec3::new(x, y, z);
            self.polygon(
                material,
                &[at(low.x, low.y), at(high.x, low.y), at(high.x, high.y), at(low.x, high.y)],
            );
        }
    }

    /// All six sides of a box.
    pub(super) fn cuboid(&mut self, material: Material, low: DVec3, high: DVec3) {
        self.sides(material, low, high, true);
    }

    /// A box without the side at its least z, which lies on a wall.
    pub(super) fn on_wall(&mut self, material: Material, low: DVec3, high: DVec3) {
        self.sides(material, low, high, false);
    }

    fn sides(&mut self, material: Material, low: DVec3, high: DVec3, back: bool) {
        let (l, h) = (low, high);
        let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
        self.polygon(material, &[at(l.x, l.y, h.z), at(h.x, l.y, h.z), at(h.x, h.y, h.z), at(l.x, h.y, h.z)]);
        self.polygon(material, &[at(h.x, l.y, h.z), at(h.x, l.y, l.z), at(h.x, h.y, l.z), at(h.x, h.y, h.z)]);
        self.polygon(material, &[at(l.x, l.y, l.z), at(l.x, l.y, h.z), at(l.x, h.y, h.z), at(l.x, h.y, l.z)]);
        self.polygon(material, &[at(l.x, h.y, h.z), at(h.x, h.y, h.z), at(h.x, h.y, l.z), at(l.x, h.y, l.z)]);
        self.polygon(material, &[at(l.x, l.y, l.z), at(h.x, l.y, l.z), at(h.x, l.y, h.z), at(l.x, l.y, h.z)]);
        if back {
            let corners = [at(h.x, l.y, l.z), at(l.x, l.y, l.z), at(l.x, h.y, l.z), at(h.x, h.y, l.z)];
            self.polygon(material, &corners);
        }
    }

    /// A profile swept from `from` to `to`: points (outwards, up) from the bottom of its front to the top. Its ends are
    /// closed by fans, so a profile must be seen whole from its last point.
    pub(super) fn moulding(
        &mut self,
        material: Material,
        [from, to]: [DVec3; 2],
        outwards: DVec3,
        profile: &[(f64, f64)],
    ) {
        let place = |base: DVec3, (out, up): (f64, f64)| base + outwards * out + DVec3::Y * up;
        for pair in profile.windows(2) {
            let corners =
                [place(from, pair[0]), place(to, pair[0]), place(to, pair[1]), place(from, pair[1])];
            self.polygon(material, &corners);
        }
        // From the last point, from which all others are seen.
        let end = |base: DVec3| {
            let order = profile.last().into_iter().chain(&profile[..profile.len() - 1]);
            order.map(|&point| place(base, point)).collect::<Vec<_>>()
        };
        self.polygon(material, &end(from));
        let mut other = end(to);
        other[1..].reverse();
        self.polygon(material, &other);
    }

    /// A solid of revolution about a vertical axis through `foot`: rows of (radius, height), shaded smoothly.
    pub(super) fn lathe(&mut self, material: Material, foot: DVec3, rows: &[(f64, f64)], around: usize) {
        let mut ids = Vec::with_capacity(rows.len() * around);
        for (j, &(radius, height)) in rows.iter().enumerate() {
            let (below, above) = (rows[j.saturating_sub(1)], rows[(j + 1).min(rows.len() - 1)]);
            let slope = DVec2::new(above.1 - below.1, below.0 - above.0);
            for i in 0..around {
                let turns = i as f64 / around as f64;
                let side = DVec3::new(sin_turns(turns), 0.0, cos_turns(turns));
                let at = foot + side * radius + DVec3::Y * height;
                ids.push(self.vertex(material, at, unit_or(side * slope.x + DVec3::Y * slope.y, DVec3::Y)));
            }
        }
        for j in 0..rows.len() - 1 {
            for i in 0..around {
                let next = (i + 1) % around;
                let [a, b] = [ids[j * around + i], ids[j * around + next]];
                let [d, c] = [ids[(j + 1) * around + i], ids[(j + 1) * around + next]];
                if rows[j].0 > 1e-9 {
                    self.face(material, [a, b, c]);
                }
                if rows[j + 1].0 > 1e-9 {
                    self.face(material, [a, c, d]);
                }
            }
        }
    }

    /// A polygon in the plane of y and z, clockwise seen from the right, as thick as `x` says. Its first point must see
    /// all others.
    pub(super) fn slab(&mut self, material: Material, outline: &[(f64, f64)], x: [f64; 2]) {
        let at = |x: f64, (z, y): (f64, f64)| DVec3::new(x, y, z);
        let count = outline.len();
        for i in 0..count {
            let (a, b) = (outline[i], outline[(i + 1) % count]);
            self.polygon(material, &[at(x[0], a), at(x[1], a), at(x[1], b), at(x[0], b)]);
        }
        let mut right: Vec<DVec3> = outline.iter().map(|&point| at(x[1], point)).collect();
        right[1..].reverse();
        let left: Vec<DVec3> = outline.iter().map(|&point| at(x[0], point)).collect();
        self.polygon(material, &right);
        self.polygon(material, &left);
    }

    /// A lumpy ball, such as the crown of a tree: `rows` × 2 · `rows` cells of latitude and longitude.
    pub(super) fn lump(&mut self, material: Material, seed: u64, centre: DVec3, radii: DVec3, rows: usize) {
        let around = 2 * rows;
        let mut ids = Vec::with_capacity((rows + 1) * around);
        for j in 0..=rows {
            let tilt = 0.5 * j as f64 / rows as f64 - 0.25;
            for i in 0..around {
                let turns = i as f64 / around as f64;
                let level = cos_turns(tilt);
                let way = DVec3::new(level * sin_turns(turns), sin_turns(tilt), level * cos_turns(turns));
                let bump = 1.0 + 0.18 * value3(seed, way * 2.1) + 0.26 * value3(seed ^ 7, way * 6.1);
                // Normals lean by the small bumps alone, which looks like leaves.
                let lean = DVec3::new(value3(seed ^ 8, way * 7.0), 0.3, value3(seed ^ 9, way * 7.0)) * 0.8;
                ids.push(self.vertex(material, centre + way * radii * bump, unit_or(way + lean, DVec3::Y)));
            }
        }
        for j in 0..rows {
            for i in 0..around {
                let next = (i + 1) % around;
                let [a, b] = [ids[j * around + i], ids[j * around + next]];
                let [d, c] = [ids[(j + 1) * around + i], ids[(j + 1) * around + next]];
                if j > 0 {
                    self.face(material, [a, b, c]);
                }
                if j + 1 < rows {
                    self.face(material, [a, c, d]);
                }
            }
        }
    }
}
