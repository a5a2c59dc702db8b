//! The scene description: a header, then pages of assets and their instances.
//!
//! Pages are ordered by distance and size from the start camera, so that ten thousand instances do not delay the
//! first frame. Assets are numbered by the order of their entries over all pages; an asset's entry precedes its first
//! instance.

use glam::{DVec3, Vec3};
use lodestream_geometry::index::{CHUNKS_PER_PAGE, Sphere};

use crate::blob::{BlobId, BlobPart};
use crate::encoding::{
    CodingError, Decode, Encode, Reader, Writer, decode_vector, encode_fields, encode_vector, vector_fits_f32,
};
use crate::instances;
pub use crate::instances::Instance;
use crate::limits::{
    MAX_ASSETS, MAX_BLOB_BYTES, MAX_CHUNKS, MAX_ENTRIES_PER_PAGE, MAX_INSTANCES, MAX_NAME_BYTES,
    MAX_SCENE_PAGES,
};
use crate::placement::Placement;
use crate::pose::{ORTHOGRAPHIC_FOV_Y, Pose};
use crate::proxy::Proxy;
use crate::shared::{self, SharedTexture};
use crate::terrain::{TerrainEntry, TerrainEntryError};
use crate::view::{View, ViewError};

/// First 16 bytes of a BLAKE3 hash.
pub type Fingerprint = [u8; 16];

/// Header of a scene: counts, lighting, terrain and start camera.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneHeader {
    /// Name by which clients request the scene.
    pub name: String,
    /// Hash of the whole description and its packs: equal fingerprints mean equal blobs.
    pub fingerprint: Fingerprint,
    /// Number of assets over all pages.
    pub asset_count: u32,
    /// Number of instances over all pages.
    pub instance_count: u32,
    /// Number of pages.
    pub page_count: u32,
    /// Directional and ambient light.
    pub light: SceneLighting,
    /// Background, linear RGB. Some pairs of background and ambient light stand for more: [`SceneHeader::surroundings`].
    pub background: [f32; 3],
    /// The terrain, if the scene has one.
    pub terrain: Option<Box<TerrainEntry>>,
    /// The start camera.
    pub camera: Camera,
    /// Error of proxies without a parent per distance from the start camera, where that sees them; 0 if they have one
    /// error everywhere.
    pub root_slope: f32,
}

encode_fields!(SceneHeader {
    name,
    fingerprint,
    asset_count,
    instance_count,
    page_count,
    light,
    background,
    terrain,
    camera,
    root_slope
});

/// Ambient light of scenes that specify none, linear RGB.
pub const DEFAULT_AMBIENT: [f32; 3] = [0.25; 3];
/// Background of scenes that specify none, linear RGB.
pub const DEFAULT_BACKGROUND: [f32; 3] = [0.35, 0.45, 0.6];

/// The light of a scene without its punctual lights: one directional light and a uniform ambient one, linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneLighting {
    /// Unit vector towards the directional light.
    pub direction: [f32; 3],
    /// Colour of the directional light.
    pub color: [f32; 3],
    /// Colour of the ambient light.
    pub ambient: [f32; 3],
}

encode_fields!(SceneLighting { direction, color, ambient });

/// A camera without a viewport, as scenes and people state it: the start position, and the point to orbit about.
/// [`Camera::pose`] is for drawing, [`Camera::view`] for selection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Position of the eye, in world units.
    pub eye: [f64; 3],
    /// Point in the middle of the picture, the centre to orbit about.
    pub target: [f64; 3],
    /// Approximate up vector.
    pub up: [f32; 3],
    /// Vertical field of view in radians, in (0, π).
    pub fov_y: f32,
}

encode_fields!(Camera { eye, target, up, fov_y });

impl Camera {
    /// The camera's view with a viewport.
    #[must_use]
    pub fn view(&self, viewport_px: [u32; 2], target_px: f32) -> View {
        View { target_px, ..View::look_at(self.eye, self.target, self.up, self.fov_y, viewport_px) }
    }

    /// The same camera with parallel projection: it shows what is at the target in the same size. Its eye stands so far
    /// away that the narrow field of view [`ORTHOGRAPHIC_FOV_Y`] holds the picture. Of an orthographic camera itself.
    #[must_use]
    pub fn orthographic(&self) -> Self {
        let tangent = |fov_y: f32| (f64::from(fov_y) * 0.5).tan();
        let factor = tangent(self.fov_y) / tangent(ORTHOGRAPHIC_FOV_Y);
        let target = DVec3::from(self.target);
        let eye = target + (DVec3::from(self.eye) - target) * factor;
        Self { eye: eye.into(), fov_y: ORTHOGRAPHIC_FOV_Y, ..*self }
    }

    /// The camera as a [`Pose`].
    #[must_use]
    pub fn pose(&self) -> Pose {
        let up = Vec3::from(self.up).as_dvec3();
        Pose::look_at(DVec3::from(self.eye), DVec3::from(self.target), up, f64::from(self.fov_y))
    }
}

/// A page: some assets, then some instances and proxies. At most [`MAX_ENTRIES_PER_PAGE`] of each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScenePage {
    /// Number of the page.
    pub page: u32,
    /// Number of the first asset entry; the others follow.
    pub first_asset: u32,
    /// Number of the first instance entry; the others follow.
    pub first_instance: u32,
    /// Asset entries.
    pub assets: Vec<AssetEntry>,
    /// Instance entries. They refer to assets of this page or an earlier one.
    pub instances: Vec<Instance>,
    /// Number of the first proxy; the others follow.
    pub first_proxy: u32,
    /// Proxies. They refer to assets of this page or an earlier one, and to instances of any page.
    pub proxies: Vec<Proxy>,
}

impl Encode for ScenePage {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        [self.page, self.first_asset, self.first_instance].encode(writer)?;
        self.assets.encode(writer)?;
        instances::encode(&self.instances, writer)?;
        self.first_proxy.encode(writer)?;
        self.proxies.encode(writer)
    }
}

impl Decode for ScenePage {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let [page, first_asset, first_instance] = Decode::decode(reader)?;
        Ok(Self {
            page,
            first_asset,
            first_instance,
            assets: Decode::decode(reader)?,
            instances: instances::decode(reader)?,
            first_proxy: Decode::decode(reader)?,
            proxies: Decode::decode(reader)?,
        })
    }
}

/// Entry of an asset: what a client must know before the base mesh arrives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AssetEntry {
    /// Name for people.
    pub name: String,
    /// Hash of the pack.
    pub fingerprint: Fingerprint,
    /// Origin of the asset's grid, in the asset's units; spheres are relative to it.
    pub origin: [f64; 3],
    /// Bounds of the base and the finest mesh, relative to `origin`.
    pub sphere: Sphere,
    /// Largest error of the base mesh alone, in the asset's units: the maximum of its geometric error and the visible
    /// errors of all chunks ([`lodestream_geometry::screen::visible_error`]).
    pub root_error: f32,
    /// Length of the base blob.
    pub base_bytes: u32,
    /// Number of chunks.
    pub chunk_count: u32,
    /// Textures that equal earlier ones, by ascending texture.
    pub shared: Vec<SharedTexture>,
}

impl AssetEntry {
    /// The asset and texture to request for texture `texture` of this asset, whose number is `asset`.
    #[must_use]
    pub fn sent_as(&self, asset: u32, texture: u16) -> (u32, u16) {
        match self.shared.binary_search_by_key(&texture, |shared| shared.texture) {
            Ok(at) => (self.shared[at].asset, self.shared[at].of),
            Err(_) => (asset, texture),
        }
    }

    /// The blob to request for `part` of this asset, whose number is `asset`.
    #[must_use]
    pub fn sent_blob(&self, asset: u32, part: BlobPart) -> BlobId {
        let Some(texture) = part.texture() else { return BlobId::Asset { asset, part } };
        let (asset, of) = self.sent_as(asset, texture);
        BlobId::Asset { asset, part: part.with_texture(of) }
    }

    /// Number of index pages.
    #[must_use]
    pub fn index_pages(&self) -> u32 {
        #[expect(clippy::cast_possible_truncation, reason = "`CHUNKS_PER_PAGE` is a small constant")]
        self.chunk_count.div_ceil(CHUNKS_PER_PAGE as u32)
    }
}

const SHORT_ORIGIN: u8 = 1;
const SHARES_TEXTURES: u8 = 2;

impl Encode for AssetEntry {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        let short = vector_fits_f32(&self.origin);
        let shares = !self.shared.is_empty();
        let flags = [(short, SHORT_ORIGIN), (shares, SHARES_TEXTURES)];
        flags.iter().filter(|(set, _)| *set).fold(0_u8, |all, (_, flag)| all | flag).encode(writer)?;
        self.name.encode(writer)?;
        self.fingerprint.encode(writer)?;
        encode_vector(&self.origin, short, writer)?;
        self.sphere.center.encode(writer)?;
        self.sphere.radius.encode(writer)?;
        self.root_error.encode(writer)?;
        self.base_bytes.encode(writer)?;
        self.chunk_count.encode(writer)?;
        if shares { shared::encode(&self.shared, writer) } else { Ok(()) }
    }
}

impl Decode for AssetEntry {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let flags = u8::decode(reader)?;
        if flags & !(SHORT_ORIGIN | SHARES_TEXTURES) != 0 {
            return Err(CodingError::value("unknown flags of an asset"));
        }
        let short = flags & SHORT_ORIGIN != 0;
        Ok(Self {
            name: String::decode(reader)?,
            fingerprint: Fingerprint::decode(reader)?,
            origin: decode_vector(short, reader)?,
            sphere: Sphere { center: <[f32; 3]>::decode(reader)?, radius: f32::decode(reader)? },
            root_error: f32::decode(reader)?,
            base_bytes: u32::decode(reader)?,
            chunk_count: u32::decode(reader)?,
            shared: if flags & SHARES_TEXTURES != 0 { shared::decode(reader)? } else { Vec::new() },
        })
    }
}

/// A header or page of a scene with a value out of range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SceneError {
    /// Longer than [`MAX_NAME_BYTES`].
    #[error("the scene's name is too long")]
    NameTooLong,
    /// More than [`MAX_ASSETS`].
    #[error("the scene has too many assets")]
    TooManyAssets,
    /// More than [`MAX_INSTANCES`].
    #[error("the scene has too many instances")]
    TooManyInstances,
    /// More than [`MAX_SCENE_PAGES`].
    #[error("the scene has too many pages")]
    TooManyPages,
    /// A direction or colour that is not finite.
    #[error("a light is not finite")]
    Light,
    /// A colour that is not finite.
    #[error("the background is not finite")]
    Background,
    /// A direction that is not finite.
    #[error("the start camera's up is not finite")]
    CameraUp,
    /// A point that is not finite.
    #[error("the start camera's target is not finite")]
    CameraTarget,
    /// Not in 0 to 1.
    #[error("the error of root proxies per distance is not between 0 and 1")]
    RootSlope,
    /// More than [`MAX_ENTRIES_PER_PAGE`].
    #[error("a scene page has too many entries")]
    TooManyEntries,
    /// The page's number, or those of its first entries.
    #[error("a scene page's numbers are out of range")]
    PageNumbers,
    /// Longer than [`MAX_NAME_BYTES`].
    #[error("an asset's name is too long")]
    AssetName,
    /// An origin or sphere that is not finite.
    #[error("an asset's bounds are not finite")]
    AssetBounds,
    /// A negative or infinite root error.
    #[error("an asset's root error is not a finite positive number")]
    RootError,
    /// Longer than [`MAX_BLOB_BYTES`].
    #[error("an asset's base mesh is too long")]
    BaseTooLong,
    /// More than [`MAX_CHUNKS`].
    #[error("an asset has too many chunks")]
    TooManyChunks,
    /// Not sorted, not earlier textures, or more than [`shared::MAX_SHARED_TEXTURES`].
    #[error("an asset's shared textures are not those of earlier assets, or out of order")]
    SharedTextures,
    /// An instance before its asset.
    #[error("an instance refers to an asset of a later page")]
    AssetOfLaterPage,
    /// A point that is not finite.
    #[error("an instance's place is not finite")]
    InstancePlace,
    /// A rotation that is not a unit quaternion.
    #[error("an instance's rotation is not a unit quaternion")]
    InstanceRotation,
    /// A scale that is not positive and finite.
    #[error("an instance's scale is not a finite positive number")]
    InstanceScale,
    /// A proxy without instances, or whose error is not a finite number of at least 0.
    #[error("a proxy stands for no instance, or its error is not a finite number of at least 0")]
    Proxy,
    /// The start camera is invalid.
    #[error(transparent)]
    Camera(#[from] ViewError),
    /// The terrain is invalid.
    #[error(transparent)]
    Terrain(#[from] TerrainEntryError),
}

fn ensure(ok: bool, why: SceneError) -> Result<(), SceneError> {
    if ok { Ok(()) } else { Err(why) }
}

fn finite32(v: &[f32]) -> bool {
    v.iter().all(|x| x.is_finite())
}

impl SceneHeader {
    /// Checks the ranges of all values.
    ///
    /// # Errors
    /// The first value that is out of range.
    pub fn check(&self) -> Result<(), SceneError> {
        ensure(self.name.len() <= MAX_NAME_BYTES, SceneError::NameTooLong)?;
        ensure(self.asset_count <= MAX_ASSETS, SceneError::TooManyAssets)?;
        ensure(self.instance_count <= MAX_INSTANCES, SceneError::TooManyInstances)?;
        ensure(self.page_count <= MAX_SCENE_PAGES, SceneError::TooManyPages)?;
        let light = &self.light;
        ensure(
            finite32(&light.direction) && finite32(&light.color) && finite32(&light.ambient),
            SceneError::Light,
        )?;
        ensure(finite32(&self.background), SceneError::Background)?;
        if let Some(terrain) = &self.terrain {
            terrain.check()?;
        }
        ensure(finite32(&self.camera.up), SceneError::CameraUp)?;
        ensure(self.camera.target.iter().all(|x| x.is_finite()), SceneError::CameraTarget)?;
        self.camera.view([1, 1], 1.0).check()?;
        ensure((0.0..=1.0).contains(&self.root_slope), SceneError::RootSlope)
    }
}

impl ScenePage {
    /// Checks the ranges of all values.
    ///
    /// # Errors
    /// The first value that is out of range.
    pub fn check(&self) -> Result<(), SceneError> {
        ensure(
            [self.assets.len(), self.instances.len(), self.proxies.len()]
                .iter()
                .all(|&count| count <= MAX_ENTRIES_PER_PAGE),
            SceneError::TooManyEntries,
        )?;
        ensure(
            self.page < MAX_SCENE_PAGES
                && self.first_asset <= MAX_ASSETS
                && self.first_instance <= MAX_INSTANCES,
            SceneError::PageNumbers,
        )?;
        for (number, asset) in (self.first_asset..).zip(&self.assets) {
            ensure(asset.name.len() <= MAX_NAME_BYTES, SceneError::AssetName)?;
            ensure(
                asset.origin.iter().all(|x| x.is_finite())
                    && finite32(&asset.sphere.center)
                    && asset.sphere.radius.is_finite()
                    && asset.sphere.radius >= 0.0,
                SceneError::AssetBounds,
            )?;
            ensure(asset.root_error.is_finite() && asset.root_error >= 0.0, SceneError::RootError)?;
            ensure(asset.base_bytes <= MAX_BLOB_BYTES, SceneError::BaseTooLong)?;
            ensure(asset.chunk_count <= MAX_CHUNKS, SceneError::TooManyChunks)?;
            ensure(shared::in_order(number, &asset.shared), SceneError::SharedTextures)?;
        }
        #[expect(clippy::cast_possible_truncation, reason = "entries are at most 64")]
        let known_assets = self.first_asset + self.assets.len() as u32;
        for instance in &self.instances {
            ensure(instance.asset < known_assets, SceneError::AssetOfLaterPage)?;
            let Placement { translation, rotation, scale } = instance.placement;
            ensure(translation.iter().all(|x| x.is_finite()), SceneError::InstancePlace)?;
            let length = rotation.iter().map(|x| x * x).sum::<f32>();
            ensure((0.9..=1.1).contains(&length), SceneError::InstanceRotation)?;
            ensure(scale.is_finite() && scale > 0.0, SceneError::InstanceScale)?;
        }
        ensure(self.first_proxy <= MAX_ASSETS, SceneError::PageNumbers)?;
        ensure(self.proxies.iter().all(Proxy::is_valid), SceneError::Proxy)?;
        ensure(self.proxies.iter().all(|proxy| proxy.asset < known_assets), SceneError::AssetOfLaterPage)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_orthographic_camera_shows_the_target_in_the_same_size_with_parallel_edges() {
        let camera =
            Camera { eye: [3.0, 4.0, -9.0], target: [1.0, 0.5, 2.0], up: [0.0, 1.0, 0.0], fov_y: 0.9 };
        let parallel = camera.orthographic();
        assert_eq!(parallel.orthographic(), parallel);
        parallel.view([1280, 720], 1.0).check().unwrap();
        let (before, pose) = (camera.pose(), parallel.pose());
        assert!(before.rotation.angle_between(pose.rotation) < 1e-6 && !before.is_orthographic());
        let on_picture = |pose: &Pose, at: DVec3| {
            let seen = pose.rotation.conjugate() * (at - pose.eye);
            let (tx, ty) = pose.tan_half_fov(1280, 720);
            [640.0 * seen.x / (tx * -seen.z), 360.0 * seen.y / (ty * -seen.z)]
        };
        let target = DVec3::from(camera.target);
        let [right, up, back] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| pose.rotation * axis);
        // Half a picture's height at the target.
        let half = (DVec3::from(camera.eye) - target).length() * 0.45_f64.tan();
        for (x, y) in [(1.7, 1.0), (-1.7, 0.3), (0.4, -1.0), (0.0, 0.0)] {
            let at = target + (right * x + up * y) * half;
            let (own, usual) = (on_picture(&pose, at), on_picture(&before, at));
            assert!((0..2).all(|i| (own[i] - usual[i]).abs() < 0.01), "{own:?} {usual:?}");
            // Edges along the view, as deep as half the picture is high, end where they begin.
            let end = on_picture(&pose, at - back * half);
            assert!((0..2).all(|i| (own[i] - end[i]).abs() < 0.5), "{own:?} {end:?}");
        }
    }

    fn page() -> ScenePage {
        let asset = AssetEntry { sphere: Sphere { center: [0.0; 3], radius: 1.0 }, ..AssetEntry::default() };
        ScenePage {
            page: 0,
            first_asset: 0,
            first_instance: 0,
            assets: vec![asset],
            instances: vec![Instance::at(0, [1.0, 2.0, 3.0])],
            ..ScenePage::default()
        }
    }

    #[test]
    fn invalid_pages_are_refused() {
        page().check().unwrap();
        let with = |change: fn(&mut ScenePage)| {
            let mut page = page();
            change(&mut page);
            page.check()
        };
        assert!(with(|p| p.instances[0].asset = 1).is_err());
        assert!(with(|p| p.instances[0].placement.translation[1] = f64::INFINITY).is_err());
        assert!(with(|p| p.instances[0].placement.rotation = [0.0; 4]).is_err());
        assert!(with(|p| p.instances[0].placement.scale = 0.0).is_err());
        assert!(with(|p| p.instances[0].placement.scale = f32::NAN).is_err());
        assert!(with(|p| p.assets[0].root_error = -1.0).is_err());
        assert!(with(|p| p.assets[0].sphere.radius = f32::INFINITY).is_err());
        assert!(with(|p| p.assets[0].base_bytes = u32::MAX).is_err());
        assert!(with(|p| p.assets[0].chunk_count = u32::MAX).is_err());
        assert!(with(|p| p.assets[0].name = "x".repeat(300)).is_err());
        assert!(with(|p| p.assets[0].shared = vec![SharedTexture { texture: 0, asset: 1, of: 0 }]).is_err());
        assert!(with(|p| p.first_asset = u32::MAX).is_err());
        assert!(with(|p| p.instances = vec![Instance::at(0, [0.0; 3]); 65]).is_err());
    }

    #[test]
    fn points_are_placed_about_the_grid_origin() {
        let instance =
            Instance { asset: 0, placement: Placement { scale: 2.0, ..Placement::at([1e7, 0.0, 0.0]) } };
        let world = instance.to_world([0.25, 0.0, 0.0], [0.125, 1.0, 0.0]);
        assert_eq!(world, DVec3::new(1e7 + 0.75, 2.0, 0.0));
    }

    #[test]
    fn index_pages_cover_all_chunks() {
        let pages = |chunk_count| AssetEntry { chunk_count, ..AssetEntry::default() }.index_pages();
        assert_eq!([0, 1, 64, 65].map(pages), [0, 1, 1, 2]);
    }

    fn equal(texture: u16, asset: u32, of: u16) -> SharedTexture {
        SharedTexture { texture, asset, of }
    }

    #[test]
    fn shared_textures_are_requested_as_the_earlier_one() {
        let entry = AssetEntry { shared: vec![equal(1, 0, 4), equal(3, 2, 0)], ..AssetEntry::default() };
        assert_eq!([0, 1, 2, 3].map(|texture| entry.sent_as(7, texture)), [(7, 0), (0, 4), (7, 2), (2, 0)]);
        let part = BlobPart::Texture { texture: 3, level: 5 };
        assert_eq!(entry.sent_blob(7, part), BlobId::texture(2, 0, 5));
        assert_eq!(entry.sent_blob(7, BlobPart::Base), BlobId::base(7));
    }
}
