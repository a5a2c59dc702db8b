//! Streamed textures, whose mip levels arrive coarse to fine.
//!
//! GPU memory follows the received levels: the texture is allocated down to the finest received level, and replaced by
//! a larger one (levels copied on the GPU) when a finer one arrives. Views cover only the unbroken run of levels from
//! the coarsest up, so that trilinear filtering never reads a missing level.
//!
//! Levels from [`TextureShape::whole_levels`] on are in tiles, which come and go one by one (`texture_tiles`).

use std::ops::Range;
#[cfg(any(test, feature = "client"))]
use std::sync::Weak;
use std::sync::atomic::AtomicU64;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use lodestream_scene::asset::TextureKind;
use lodestream_scene::asset::tiles::{tile_grid, tile_size};

use crate::resources::descriptors::{STREAMED, texture_2d};
use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::texture_data::TextureData;
use crate::resources::texture_shape::TextureShape;
use crate::resources::texture_tiles::{TextureTiles, TilePlace, TileSet, TiledMap};
use crate::scene::relief_acceleration::ReliefAcceleration;

/// Longest allocated side; finer levels are dropped, so that a forged size cannot claim gigabytes.
const MAX_SIDE_PX: u32 = 8192;

/// The finest level of the unbroken run from the coarsest; `None` while the coarsest is missing.
fn finest_usable(present: &[bool]) -> Option<u32> {
    (present.iter().take_while(|p| **p).count() as u32).checked_sub(1)
}

/// A texture whose levels arrive.
#[derive(Debug)]
struct StreamedTexture {
    declared: TextureShape,
    /// Shape with all its levels.
    shape: TextureShape,
    format: wgpu::TextureFormat,
    /// Of the whole levels.
    present: Vec<bool>,
    /// Finest level that may be allocated on this device, if any.
    limit: Option<u32>,
    /// The texture and its finest level: the GPU's mip level 0.
    allocated: Option<(wgpu::Texture, u32)>,
    /// Relief acceleration textures, with the level that they were built from; the inner `None` marks height maps that
    /// are too large.
    accelerations: [Option<(u32, Option<wgpu::Texture>)>; ReliefAcceleration::COUNT],
    /// Its tiles in the pool of the renderer that first drew it, if it has tiled levels.
    tiles: Option<TileSet>,
}

impl StreamedTexture {
    fn new(gpu: &Gpu, declared: TextureShape) -> Self {
        let shape = declared;
        let full = TextureShape::full(shape.width, shape.height, shape.kind).levels;
        let shape = TextureShape { levels: shape.levels.clamp(1, full), ..shape };
        let side = gpu.device.limits().max_texture_dimension_2d.min(MAX_SIDE_PX);
        let fits = |level: &u32| {
            let (w, h) = shape.level_size(*level);
            w.max(h) <= side
        };
        let limit = (0..shape.whole()).rev().find(fits);
        let format = match shape.kind {
            TextureKind::Color => wgpu::TextureFormat::Rgba8UnormSrgb,
            TextureKind::Normal | TextureKind::Surface => wgpu::TextureFormat::Rgba8Unorm,
            TextureKind::Height
                if gpu.device.features().contains(wgpu::Features::TEXTURE_FORMAT_16BIT_NORM) =>
            {
                wgpu::TextureFormat::R16Unorm
            }
            TextureKind::Height => wgpu::TextureFormat::R8Unorm,
        };
        let present = vec![false; shape.whole() as usize];
        let accelerations = Default::default();
        Self { declared, shape, format, present, limit, allocated: None, accelerations, tiles: None }
    }

    /// Bytes of the allocated levels.
    fn bytes(&self) -> u64 {
        let texel = u64::from(self.format.block_copy_size(None).unwrap_or(1));
        let level = |level| {
            let (width, height) = self.shape.level_size(level);
            u64::from(width) * u64::from(height) * texel
        };
        self.allocated.as_ref().map_or(0, |(_, top)| (0..=*top).map(level).sum())
    }

    /// Finest level in use, once the coarsest has arrived.
    fn finest(&self) -> Option<u32> {
        finest_usable(&self.present)
    }

    /// Uploads some rows of one level; `data` holds the whole level, and earlier rows were uploaded before. Returns
    /// whether the picture changes: once the last row is uploaded.
    fn upload(
        &mut self,
        gpu: &Gpu,
        level: u32,
        data: TextureData<'_>,
        rows: &Range<u32>,
    ) -> Result<bool, RenderError> {
        let count = self.present.len();
        let Some(slot) = self.present.get_mut(level as usize) else {
            return Err(RenderError::NoSuch { what: "texture level", index: level as usize, count });
        };
        let (width, height) = self.shape.level_size(level);
        let expected = width as usize * height as usize;
        if data.texels() != expected {
            return Err(RenderError::LevelSize { level, width, height, expected, got: data.texels() });
        }
        if self.limit.is_none_or(|limit| level > limit) {
            return Ok(false);
        }
        let rows = rows.start.min(height)..rows.end.min(height);
        let whole = rows.end == height;
        *slot |= whole;
        self.reach(gpu, level);
        if let Some((texture, top)) = self.allocated.as_ref().filter(|_| !rows.is_empty()) {
            let to = wgpu::TexelCopyTextureInfo {
                texture,
                mip_level: top - level,
                origin: wgpu::Origin3d { x: 0, y: rows.start, z: 0 },
                aspect: wgpu::TextureAspect::All,
            };
            data.write(gpu, to, self.format, (width, &rows));
        }
        Ok(whole)
    }

    /// Allocates `level`, and copies the coarser levels.
    fn reach(&mut self, gpu: &Gpu, level: u32) {
        if self.allocated.as_ref().is_some_and(|(_, top)| *top >= level) {
            return;
        }
        let new = gpu.device.create_texture(&wgpu::TextureDescriptor {
            mip_level_count: level + 1,
            ..texture_2d("streamed texture", self.shape.level_size(level), self.format, STREAMED)
        });
        if let Some((old, top)) = &self.allocated {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            for l in 0..=*top {
                let (width, height) = self.shape.level_size(l);
                let side = |texture, base| wgpu::TexelCopyTextureInfo {
                    texture,
                    mip_level: base - l,
                    origin: wgpu::Origin3d::ZERO,
                    aspect: wgpu::TextureAspect::All,
                };
                encoder.copy_texture_to_texture(
                    side(old, *top),
                    side(&new, level),
                    wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                );
            }
            gpu.queue.submit([encoder.finish()]);
        }
        self.allocated = Some((new, level));
    }

    /// A view of the usable levels.
    fn view(&self) -> Option<wgpu::TextureView> {
        let finest = self.finest()?;
        let (texture, top) = self.allocated.as_ref()?;
        Some(
            texture.create_view(&wgpu::TextureViewDescriptor {
                base_mip_level: top - finest,
                ..Default::default()
            }),
        )
    }

    /// The allocated texture, and the finest level in use.
    fn used_levels(&self) -> Option<(wgpu::Texture, u32)> {
        Some((self.allocated.as_ref()?.0.clone(), self.finest()?))
    }

    /// Checks the place of a tile, and returns the size of its image.
    fn tile_size(&self, TilePlace { level, column, row }: TilePlace) -> Result<[u32; 2], RenderError> {
        let no = |what, index: u32, count: u32| RenderError::NoSuch {
            what,
            index: index as usize,
            count: count as usize,
        };
        if level < self.shape.whole() || level >= self.shape.levels {
            return Err(no("tiled texture level", level, self.shape.levels));
        }
        let size = self.shape.level_size(level).into();
        let [columns, rows] = tile_grid(size);
        if column >= columns {
            return Err(no("column of tiles", column, columns));
        }
        if row >= rows {
            return Err(no("row of tiles", row, rows));
        }
        Ok(tile_size(size, column, row))
    }

    fn set_tile(
        &self,
        gpu: &Gpu,
        place: TilePlace,
        data: TextureData<'_>,
        shared: bool,
    ) -> Result<(), RenderError> {
        let size @ [width, height] = self.tile_size(place)?;
        if !data.has_size(size) {
            let TilePlace { level, column, row } = place;
            let got = data.texels();
            return Err(RenderError::TileSize { level, column, row, width, height, got });
        }
        let tiles = self.tiles.as_ref().ok_or(RenderError::NoTilePool)?;
        if shared && tiles.has(place) {
            return Ok(());
        }
        tiles.set(gpu, place, |to, format| data.write(gpu, to, format, (width, &(0..height))))
    }

    /// The relief acceleration texture of the finest level in use. Built once per level, which waits for the device;
    /// `None` for maps that are too large, without a level, or if readback fails.
    fn acceleration(&mut self, gpu: &Gpu, acceleration: ReliefAcceleration) -> Option<wgpu::TextureView> {
        let finest = self.finest()?;
        let kept = &mut self.accelerations[acceleration.number()];
        if kept.as_ref().is_none_or(|(level, _)| *level != finest) {
            let (texture, top) = self.allocated.as_ref()?;
            let made = acceleration.make(gpu, texture, top - finest);
            let made = made.inspect_err(|why| tracing::warn!("relief is found by equal steps: {why}"));
            *kept = Some((finest, made.ok().flatten()));
        }
        let (_, made) = kept.as_ref()?;
        made.as_ref().map(|texture| texture.create_view(&Default::default()))
    }
}

/// A texture in GPU memory for [`crate::Renderer::create_asset_with`]. Clones share one texture, so that several
/// assets may use it; the last clone frees it.
#[derive(Clone, Debug)]
pub struct Texture(Arc<Mutex<StreamedTexture>>);

impl Texture {
    /// A texture without levels.
    #[must_use]
    pub fn new(gpu: &Gpu, shape: TextureShape) -> Self {
        Self(Arc::new(Mutex::new(StreamedTexture::new(gpu, shape))))
    }

    /// Size and purpose, as given.
    #[must_use]
    pub fn declared_shape(&self) -> TextureShape {
        self.streamed().declared
    }

    /// GPU memory of the whole levels that are allocated, in bytes; tiles are in [`crate::Renderer::texture_tiles`].
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.streamed().bytes()
    }

    /// Sets a tile of a tiled level; level 0 is the texture's coarsest, whole or not. `data` is the tile's image with
    /// its borders, of [`lodestream_scene::asset::tiles::tile_size`]. From the next frame on it fades in for 0.15
    /// seconds, over what was there before; a frame at `f32::MAX` seconds ends that. The texture must be an asset's; a
    /// shared one takes each tile once, and all assets show it. Only between frames: not while a recorded one waits to
    /// be submitted.
    ///
    /// # Errors
    /// [`RenderError::NoSuch`], [`RenderError::TileSize`], or [`RenderError::NoTilePool`] before an asset has the
    /// texture; [`RenderError::NoTileRoom`] if the budget ([`crate::Renderer::set_texture_tile_budget`]) is used up:
    /// other tiles must be removed first. Nothing is changed then.
    pub fn set_tile(
        &self,
        gpu: &Gpu,
        level: u32,
        column: u32,
        row: u32,
        data: TextureData<'_>,
    ) -> Result<(), RenderError> {
        let shared = Arc::strong_count(&self.0) > 1;
        self.streamed().set_tile(gpu, TilePlace { level, column, row }, data, shared)
    }

    /// Removes a tile: the next coarser one is shown in its place, or the finest whole level. Returns whether it was
    /// there. Its memory can be used at once.
    ///
    /// # Errors
    /// [`RenderError::NoSuch`]; nothing is changed then.
    pub fn remove_tile(&self, level: u32, column: u32, row: u32) -> Result<bool, RenderError> {
        let (streamed, place) = (self.streamed(), TilePlace { level, column, row });
        streamed.tile_size(place)?;
        Ok(streamed.tiles.as_ref().is_some_and(|tiles| tiles.remove(place)))
    }

    /// Whether a tile is there.
    #[must_use]
    pub fn has_tile(&self, level: u32, column: u32, row: u32) -> bool {
        let place = TilePlace { level, column, row };
        self.streamed().tiles.as_ref().is_some_and(|tiles| tiles.has(place))
    }

    /// Whether levels are tiled.
    #[must_use]
    pub fn is_tiled(&self) -> bool {
        let shape = self.streamed().shape;
        shape.whole() < shape.levels
    }

    /// Gives the texture a place in a renderer's pool of tiles, if it needs one and has none. Without room in the page
    /// table the texture stays as coarse as its whole levels.
    pub(crate) fn attach(&self, gpu: &Gpu, pool: &TextureTiles) {
        let mut streamed = self.streamed();
        let whole = streamed.shape.whole();
        if whole < streamed.shape.levels && streamed.tiles.is_none() {
            let added = pool.add(gpu, &streamed.shape, whole);
            streamed.tiles = added.inspect_err(|why| tracing::warn!("texture without tiles: {why}")).ok();
        }
    }

    /// What materials of a renderer say of the texture's tiles, once the coarsest level is there.
    pub(crate) fn tiled_map(&self, pool: &TextureTiles) -> Option<TiledMap> {
        let streamed = self.streamed();
        streamed.finest()?;
        streamed.tiles.as_ref()?.map(pool)
    }

    /// Another number for each change of tiles, if the texture has any.
    pub(crate) fn tile_stamp(&self) -> Option<Arc<AtomicU64>> {
        Some(Arc::clone(self.streamed().tiles.as_ref()?.stamp()))
    }

    #[cfg(any(test, feature = "client"))]
    /// A weak reference.
    pub(crate) fn downgrade(&self) -> WeakTexture {
        WeakTexture(Arc::downgrade(&self.0))
    }

    // No panic can happen between changes that belong together, so a poisoned lock is consistent.
    fn streamed(&self) -> MutexGuard<'_, StreamedTexture> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Mean colour, linear, used while there is no level.
    pub(crate) fn mean(&self) -> [f32; 3] {
        self.streamed().shape.mean
    }

    pub(crate) fn kind(&self) -> TextureKind {
        self.streamed().shape.kind
    }

    /// Finest level in use, once the coarsest has arrived.
    pub(crate) fn finest(&self) -> Option<u32> {
        self.streamed().finest()
    }

    /// A view of the usable levels.
    pub(crate) fn view(&self) -> Option<wgpu::TextureView> {
        self.streamed().view()
    }

    /// What [`Texture::view`] shows: the allocated texture, and the finest level in use.
    pub(crate) fn used_levels(&self) -> Option<(wgpu::Texture, u32)> {
        self.streamed().used_levels()
    }

    /// The relief acceleration texture ([`StreamedTexture::acceleration`]).
    pub(crate) fn acceleration(
        &self,
        gpu: &Gpu,
        acceleration: ReliefAcceleration,
    ) -> Option<wgpu::TextureView> {
        self.streamed().acceleration(gpu, acceleration)
    }

    /// Uploads some rows of one level, whole in `data`. A texture shared by several assets takes each level once.
    /// Returns whether the picture may change.
    pub(crate) fn upload(
        &self,
        gpu: &Gpu,
        level: u32,
        data: TextureData<'_>,
        rows: &Range<u32>,
    ) -> Result<bool, RenderError> {
        let shared = Arc::strong_count(&self.0) > 1;
        let mut streamed = self.streamed();
        if shared && streamed.present.get(level as usize) == Some(&true) {
            return Ok(true);
        }
        streamed.upload(gpu, level, data, rows)
    }
}

#[cfg(any(test, feature = "client"))]
/// A weak reference to a [`Texture`].
#[derive(Clone, Debug)]
pub(crate) struct WeakTexture(Weak<Mutex<StreamedTexture>>);

#[cfg(any(test, feature = "client"))]
impl WeakTexture {
    pub(crate) fn upgrade(&self) -> Option<Texture> {
        self.0.upgrade().map(Texture)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_an_unbroken_run_of_levels_is_used() {
        assert_eq!(finest_usable(&[false, false, false]), None);
        assert_eq!(finest_usable(&[false, true, true]), None);
        assert_eq!(finest_usable(&[true, false, false]), Some(0));
        assert_eq!(finest_usable(&[true, false, true]), Some(0));
        assert_eq!(finest_usable(&[true, true, true]), Some(2));
    }
}
