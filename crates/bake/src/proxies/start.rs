//! The base mesh of a root for the scene's start camera: view-dependent simplification (Hoppe, "View-dependent refinement
//! of progressive meshes", 1997).
//!
//! A root with one error everywhere shows shards near the camera. Here the error that a component may have grows with its
//! distance from the camera, and is larger where the camera does not see it. Components of similar allowed errors are
//! simplified together, to that error, and all base meshes that result become one.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};
use lodestream_compress::prepare;
use lodestream_geometry::ancestor_closed_cut::Member as CutMember;
use lodestream_geometry::base::Base;
use lodestream_geometry::mesh::{Corner, NONE, QuantisedMesh, SourceMesh};
use lodestream_geometry::normals::wedge_normals;
use lodestream_geometry::pool::Silent;
use lodestream_geometry::prepare::suit;
use lodestream_geometry::quantise::{Precision, QuantiseSettings, quantise};
use lodestream_geometry::{MeshError, Settings};
use lodestream_scene::description::Camera;
use lodestream_scene::placement::Placement;
use lodestream_scene::proxy::{START_VIEWPORT_PX, UNSEEN};
use lodestream_scene::view::Frustum;
use lodestream_store::{LoadedAsset, PackFile, StoreError};
use lodestream_threads::Threads;

use super::components::connected;
use super::item_buffer::ItemBuffer;
use super::mesh::Piece;
use crate::preparation_settings::CodecChoice;

/// Errors that are tried in the start camera's view, in pixels: the first that gives few enough bytes is taken.
pub(super) const ERRORS_PX: [f64; 8] = [12.0, 16.0, 22.0, 32.0, 45.0, 64.0, 90.0, 128.0];
/// Most bytes of all roots, unless the last of the errors gives more.
pub(super) const MAX_BYTES: usize = 36 << 10;
/// Share of an error's bytes that the next error gives at least.
pub(super) const LEAST_SHARE: f64 = 0.75;
/// Share of the first error that the meshes may have that are simplified.
const SOURCE_SHARE: f64 = 0.5;
/// Most faces that are simplified, some 200 bytes each, unless there are more at the last of the errors.
const MAX_SOURCE_FACES: usize = 1 << 19;
/// A component counts as seen if it has this share of the pixels of a square of the error.
const MIN_SHOWN: f64 = 1.0 / 16.0;
/// [`Settings::visible_side`]: of thousands of windows, those that are hardly seen are left out.
const VISIBLE_SIDE: f64 = 1.0;
/// Distance below which the error does not fall, as a share of the scene's radius.
const NEAREST: f64 = 1.0 / 256.0;
/// Rounding of positions, as a share of the least error.
const ROUNDING: f64 = 1.0 / 8.0;

/// Whether there are too many faces to be simplified to `error_px`, and a larger error is left.
pub(super) fn is_too_much(faces: usize, error_px: f64) -> bool {
    faces > MAX_SOURCE_FACES && ERRORS_PX.iter().any(|&larger| larger > error_px)
}

/// What the start camera allows.
pub(super) struct StartView {
    camera: Camera,
    eye: DVec3,
    frustum: Frustum,
    nearest: f64,
    /// Length of a pixel per distance.
    pixel: f64,
}

impl StartView {
    /// For a scene with a radius.
    pub(super) fn new(camera: &Camera, radius: f64) -> Self {
        let view = camera.view(START_VIEWPORT_PX, 1.0);
        Self {
            camera: *camera,
            eye: camera.eye.into(),
            frustum: view.frustum(),
            nearest: (NEAREST * radius).max(f64::MIN_POSITIVE),
            pixel: 1.0 / view.scale_px(),
        }
    }

    /// What the result depends on besides the meshes.
    pub(super) fn key(&self) -> Vec<u8> {
        let Camera { eye, target, up, fov_y } = self.camera;
        let lengths =
            eye.into_iter().chain(target).chain([self.nearest, VISIBLE_SIDE, UNSEEN]).chain(ERRORS_PX);
        let mut key: Vec<u8> = lengths.flat_map(f64::to_le_bytes).collect();
        key.extend(up.into_iter().chain([fov_y]).flat_map(f32::to_le_bytes));
        key.extend(MAX_BYTES.to_le_bytes());
        key
    }

    /// Error per distance.
    pub(super) fn slope(&self, error_px: f64) -> f64 {
        self.pixel * error_px
    }

    /// The least error.
    fn least(&self, error_px: f64) -> f64 {
        self.slope(error_px) * self.nearest
    }

    /// Rounding of positions.
    pub(super) fn rounding(&self, error_px: f64) -> f64 {
        ROUNDING * self.least(error_px)
    }

    /// An empty item buffer of the camera.
    pub(super) fn item_buffer(&self) -> ItemBuffer {
        ItemBuffer::new(self.eye, &self.camera, self.nearest / 16.0)
    }

    /// Whether a component with a number of pixels counts as seen.
    pub(super) fn is_shown(&self, error_px: f64, pixels: u32) -> bool {
        pixels >= ((MIN_SHOWN * error_px * error_px) as u32).max(1)
    }

    /// Allowed error within a sphere in which nothing is seen.
    pub(super) fn allowed_hidden(&self, error_px: f64, center: DVec3, radius: f64) -> f64 {
        UNSEEN * self.slope(error_px) * (center.distance(self.eye) - radius).max(self.nearest)
    }

    /// Allowed error within a sphere, as far as the frustum tells.
    fn allowed(&self, error_px: f64, center: DVec3, radius: f64) -> f64 {
        let relative = center - self.eye;
        let is_seen = self.frustum.sees(relative.as_vec3(), radius as f32);
        let distance = (relative.length() - radius).max(self.nearest);
        self.slope(error_px) * distance * if is_seen { 1.0 } else { UNSEEN }
    }

    /// Whether a mesh with an error is fine enough to be simplified to `error_px`.
    pub(super) fn is_fine(&self, error_px: f64, error: f64, center: DVec3, radius: f64) -> bool {
        error <= SOURCE_SHARE * self.allowed(error_px, center, radius)
    }

    /// A pack's mesh, as fine as needed to be simplified to `error_px`, and its error in world units.
    ///
    /// # Errors
    /// Damage.
    pub(super) fn refined(
        &self,
        error_px: f64,
        pack: &PackFile,
        asset: &LoadedAsset,
        placement: &Placement,
        transparent_too: bool,
    ) -> Result<(Piece, f64), StoreError> {
        let origin = DVec3::from(asset.base.grid.origin);
        let scale = f64::from(placement.scale);
        let mut is_wanted = vec![false; asset.infos.len()];
        for (at, info) in asset.infos.iter().enumerate().rev() {
            let center = placement.to_world(origin + Vec3::from(info.sphere.center).as_dvec3());
            let radius = f64::from(info.sphere.radius) * scale;
            is_wanted[at] |= !self.is_fine(error_px, f64::from(info.error) * scale, center, radius);
            if is_wanted[at] {
                info.parents.iter().for_each(|&parent| is_wanted[parent as usize] = true);
            }
        }
        let wanted = (0..).zip(&is_wanted).filter(|(_, is_wanted)| **is_wanted);
        let set: Vec<CutMember> = wanted.map(|(chunk, _)| CutMember { chunk, truncation: None }).collect();
        let mesh = asset.refined(&set).map_err(|why| pack.damaged(why))?.to_mesh();
        let QuantisedMesh { positions, wedges, faces, parts, skins, .. } = mesh;
        let left = asset.infos.iter().zip(&is_wanted).filter(|(_, is_wanted)| !**is_wanted);
        let error = left.map(|(info, _)| f64::from(info.error) * scale).fold(0.0, f64::max);
        let base = Base { positions, wedges, faces, parts, skins, ..asset.base.clone() };
        Ok((Piece::of(pack, base, transparent_too)?, error))
    }

    /// Simplifies components as the view allows. Gives the mesh and its largest error.
    ///
    /// # Errors
    /// As [`prepare`].
    pub(super) fn simplified(
        &self,
        mesh: &SourceMesh,
        components: &Components,
        error_px: f64,
        threads: Threads,
    ) -> Result<(SourceMesh, f64), MeshError> {
        let least = self.least(error_px);
        // Faces by the binary logarithm of the allowed error.
        let mut groups: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (face, &number) in (0..).zip(&components.of_face) {
            let Component { low, high, shown } = components.list[number as usize];
            let center = (low + high) / 2.0;
            let mut allowed = self.allowed(error_px, center, center.distance(high));
            if !self.is_shown(error_px, shown) {
                allowed = allowed.max(UNSEEN * self.slope(error_px) * center.distance(self.eye));
            }
            let group = (allowed / least).log2().max(0.0) as u32;
            groups.entry(group).or_default().push(face);
        }
        let (mut whole, mut most) = (SourceMesh::default(), 0.0_f64);
        for (group, faces) in groups {
            let base = coarsest(&of_faces(mesh, &faces), least * f64::from(group).exp2(), threads)?;
            most = most.max(f64::from(base.geometric_error));
            append(&mut whole, base);
        }
        Ok((whole, most))
    }
}

/// The connected components of a mesh.
pub(super) struct Components {
    /// By face.
    of_face: Vec<u32>,
    list: Vec<Component>,
}

#[derive(Clone, Copy)]
struct Component {
    low: DVec3,
    high: DVec3,
    /// In how many pixels the start camera sees it.
    shown: u32,
}

impl Components {
    /// Cost: filling each face once.
    pub(super) fn new(mesh: &SourceMesh, view: &StartView) -> Self {
        let corners = mesh.faces.iter().map(|face| face.map(|corner| corner.position));
        let (of_face, count) = connected(mesh.positions.len(), corners);
        let mut list = vec![Component { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY, shown: 0 }; count];
        let mut buffer = view.item_buffer();
        for (face, &number) in mesh.faces.iter().zip(&of_face) {
            let triangle = face.map(|corner| DVec3::from(mesh.positions[corner.position as usize]));
            let component = &mut list[number as usize];
            for point in triangle {
                component.low = component.low.min(point);
                component.high = component.high.max(point);
            }
            buffer.draw(triangle, number);
        }
        for (component, shown) in list.iter_mut().zip(buffer.counts(count)) {
            component.shown = shown;
        }
        Self { of_face, list }
    }
}

/// Some faces of a mesh.
fn of_faces(mesh: &SourceMesh, faces: &[u32]) -> SourceMesh {
    let mut own = SourceMesh::default();
    let mut names: BTreeMap<u32, u32> = BTreeMap::new();
    for &face in faces {
        let corners = mesh.faces[face as usize].map(|corner| {
            let position = *names.entry(corner.position).or_insert_with(|| {
                own.positions.push(mesh.positions[corner.position as usize]);
                own.positions.len() as u32 - 1
            });
            let normal = mesh.normals.get(corner.normal as usize).map_or(NONE, |normal| {
                own.normals.push(*normal);
                own.normals.len() as u32 - 1
            });
            own.colors.push(mesh.colors[corner.color as usize]);
            Corner { normal, color: own.colors.len() as u32 - 1, ..Corner::at(position) }
        });
        own.faces.push(corners);
        own.parts.push(mesh.parts[face as usize]);
    }
    own.materials.resize(own.faces.len(), 0);
    own
}

/// The base mesh of a mesh with an error in its units.
fn coarsest(mesh: &SourceMesh, error: f64, threads: Threads) -> Result<Base, MeshError> {
    let points = || mesh.positions.iter().map(|&point| DVec3::from(point));
    let diagonal =
        points().fold(DVec3::INFINITY, DVec3::min).distance(points().fold(DVec3::NEG_INFINITY, DVec3::max));
    let settings =
        QuantiseSettings { precision: Precision::Tolerance(ROUNDING * error), ..QuantiseSettings::default() };
    let mut quantised = quantise(mesh, &settings)?;
    let codec = CodecChoice::Auto.of(&quantised);
    suit(&mut quantised, codec);
    let base_error = (error / diagonal.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    let settings = Settings { base_error, visible_side: VISIBLE_SIDE, codec, ..Settings::default() };
    Ok(prepare(&quantised, &settings, &threads, &Silent)?.base)
}

/// Adds a base mesh to a mesh.
fn append(whole: &mut SourceMesh, base: Base) {
    let mesh = QuantisedMesh {
        grid: base.grid,
        uv_grid: base.uv_grid,
        second_uv_grid: base.second_uv_grid,
        positions: base.positions,
        wedges: base.wedges,
        faces: base.faces,
        parts: base.parts,
        skins: Vec::new(),
        poses: Vec::new(),
    };
    let first = whole.positions.len() as u32;
    whole.positions.extend(mesh.positions.iter().map(|&q| -> [f64; 3] { mesh.grid.position(q) }));
    let wedge = whole.normals.len() as u32;
    whole.normals.extend(wedge_normals(&mesh).into_iter().map(|n| n.map(|x| x as f32)));
    whole.colors.extend(mesh.wedges.iter().map(|wedge| wedge.attributes.color));
    for face in &mesh.faces {
        whole.faces.push(face.wedges.map(|w| Corner {
            normal: wedge + w,
            color: wedge + w,
            ..Corner::at(first + mesh.wedges[w as usize].vertex)
        }));
        let vertex = mesh.wedges[face.wedges[0] as usize].vertex;
        whole.parts.push(mesh.parts.get(vertex as usize).copied().unwrap_or(0));
        whole.materials.push(0);
    }
}
