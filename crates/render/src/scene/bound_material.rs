//! A material ready to draw with. Equal materials share one, so that their draws need no change of bind groups.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, Weak};

use lodestream_scene::asset::{Alpha, Material};

use crate::resources::gpu::Gpu;
use crate::resources::texture::Texture;
use crate::scene::relief_acceleration::ReliefAcceleration;

/// A material ready to draw with.
#[derive(Debug)]
pub(crate) struct BoundMaterial {
    /// Unique number.
    pub(crate) number: u64,
    pub(crate) group: wgpu::BindGroup,
    pub(crate) features: Features,
    /// The height map, if it may have an acceleration texture.
    heights: Option<Texture>,
    /// Group 3 with each acceleration texture; the inner `None` marks maps without one.
    accelerations: [OnceLock<Option<wgpu::BindGroup>>; ReliefAcceleration::COUNT],
    acceleration_layout: wgpu::BindGroupLayout,
    key: MaterialKey,
    cache: Weak<CacheMap>,
}

/// Everything that a bound material depends on.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct MaterialKey {
    /// Bytes of the uniform.
    pub(crate) uniform: Vec<u8>,
    /// Samplers in u and v.
    pub(crate) wrap: [usize; 2],
    /// Textures with their finest levels in use.
    pub(crate) textures: [Option<(wgpu::Texture, u32)>; 6],
    /// Part states and attributes of vertices.
    pub(crate) tables: [Option<wgpu::Texture>; 2],
    pub(crate) features: Features,
    /// Whether the height map may have an acceleration texture.
    pub(crate) accelerated: bool,
}

type CacheMap = Mutex<HashMap<MaterialKey, Weak<BoundMaterial>>>;

/// Bound materials in use, by content. Clones share one. It is only looked up in: its order reaches nothing.
#[derive(Clone, Debug, Default)]
pub(crate) struct MaterialCache(Arc<CacheMap>);

impl MaterialCache {
    /// The material with this key, else a new one with the bind group that `bind` creates; `heights` is the height map if
    /// it may have an acceleration texture.
    pub(crate) fn get(
        &self,
        key: MaterialKey,
        heights: Option<Texture>,
        acceleration_layout: &wgpu::BindGroupLayout,
        bind: impl FnOnce() -> wgpu::BindGroup,
    ) -> Arc<BoundMaterial> {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let mut map = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(there) = map.get(&key).and_then(Weak::upgrade) {
            return there;
        }
        let new = Arc::new(BoundMaterial {
            number: NEXT.fetch_add(1, Ordering::Relaxed),
            group: bind(),
            features: key.features,
            heights,
            accelerations: Default::default(),
            acceleration_layout: acceleration_layout.clone(),
            key: key.clone(),
            cache: Arc::downgrade(&self.0),
        });
        map.insert(key, Arc::downgrade(&new));
        new
    }

    /// Number of materials in use.
    #[cfg(test)]
    pub(crate) fn len(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).len()
    }
}

impl Drop for BoundMaterial {
    /// Forgets the key, which keeps textures alive.
    fn drop(&mut self) {
        let Some(cache) = self.cache.upgrade() else { return };
        let mut map = cache.lock().unwrap_or_else(PoisonError::into_inner);
        // An equal material may have been bound since.
        if map.get(&self.key).is_some_and(|there| there.strong_count() == 0) {
            map.remove(&self.key);
        }
    }
}

impl BoundMaterial {
    /// Group 3 with an acceleration texture, built on first use; `None` if the search must do without.
    pub(crate) fn acceleration(
        &self,
        gpu: &Gpu,
        acceleration: ReliefAcceleration,
    ) -> Option<&wgpu::BindGroup> {
        let group = self.accelerations[acceleration.number()].get_or_init(|| {
            let view = self.heights.as_ref()?.acceleration(gpu, acceleration)?;
            Some(gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("relief's acceleration"),
                layout: &self.acceleration_layout,
                entries: &[wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(&view),
                }],
            }))
        });
        group.as_ref()
    }
}

/// Shader features of a material.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct Features {
    /// Height map.
    pub(crate) relief: bool,
    /// Normal, surface or occlusion map.
    pub(crate) maps: bool,
    /// Maps that use the second set of texture coordinates, or an occlusion map.
    pub(crate) second_uv: bool,
    /// Alpha test.
    pub(crate) mask: bool,
    /// Transparency.
    pub(crate) blend: bool,
    /// Transmission of light.
    pub(crate) transmits: bool,
    /// Emission.
    pub(crate) emits: bool,
    /// Specular reflection that is not the usual, or a clear coat.
    pub(crate) specular: bool,
    /// A map with tiled levels.
    pub(crate) tiled: bool,
    /// Faces have their own normals, so they are not curved.
    pub(crate) flat: bool,
    /// Parts may be hidden, tinted or moved, and vertices skinned.
    pub(crate) states: bool,
}

impl Features {
    /// Whether the relief's depth can be written; emission and specular reflection are drawn at the mesh's own depth.
    pub(crate) const fn relief_may_be_deep(self) -> bool {
        self.relief && !self.emits && !self.specular && !self.blend
    }

    /// Features once all textures have arrived, if they are whole.
    pub(crate) fn of(material: &Material) -> Self {
        let maps = [material.surface_texture, material.normal_texture, material.occlusion_texture];
        Self {
            relief: material.height_texture.is_some() && material.relief_depth > 0.0,
            maps: maps.iter().any(Option::is_some),
            second_uv: material.second_textures().next().is_some() || material.occlusion_texture.is_some(),
            mask: matches!(material.alpha, Alpha::Mask(_)),
            blend: material.alpha == Alpha::Blend,
            transmits: material.alpha == Alpha::Blend && !material.unlit && material.transmission > 0.0,
            emits: material.emits(),
            specular: !material.unlit && (!material.specular.is_usual() || !material.clear_coat.is_none()),
            tiled: false,
            flat: material.flat,
            states: false,
        }
    }
}
