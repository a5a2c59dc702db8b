//! Sky maps on the device, and the sky's part of the frame's uniform block.

use std::sync::OnceLock;

use glam::{DVec3, Vec3};
use half::f16;

use super::atmosphere::{AtmosphereTables, SUN_RADIUS};
use super::map::{LOBE_SIDE, LOBES, SEEN_SIDE, SkyMap};
use super::maps::{Key, SkyMaps, SunPlace};
use super::octahedral::Octahedral;
use super::prefilter::{SPLIT_SUM_SIDE, split_sum};
use crate::resources::descriptors::{texture_2d, texture_bytes};
use crate::resources::gpu::Gpu;
use crate::scene::environment::{Atmosphere, Environment};

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// The sky's part of the frame's uniform block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SkyLight {
    /// Unit vectors: to the sun, up, and horizontally towards the sun.
    pub(crate) to_sun: DVec3,
    pub(crate) up: DVec3,
    pub(crate) side: DVec3,
    /// Irradiance of the sun over π.
    pub(crate) sun: Vec3,
    /// Radiance of the sun's disc, and its radius in radians.
    pub(crate) disc: [f32; 4],
    pub(crate) irradiance: [[f32; 4]; 9],
    /// Extinction by haze, per world unit.
    pub(crate) haze: f32,
}

/// The sky on the device.
#[derive(Debug)]
pub(crate) struct SkyGpu {
    seen: wgpu::Texture,
    lobes: wgpu::Texture,
    split_sum: wgpu::Texture,
    sampler: wgpu::Sampler,
    /// Tables of the last atmosphere that is not the default; they serve all positions of the sun.
    air: Option<(Atmosphere, AtmosphereTables)>,
    /// The uploaded maps.
    maps: Option<SkyMaps>,
    /// Number of maps computed while a frame waited.
    #[cfg(test)]
    pub(crate) computed: u32,
}

impl SkyGpu {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let texture = |label, side: usize, layers: usize| {
            let (side, usage) =
                (side as u32 + 2, wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST);
            let mut descriptor = texture_2d(label, (side, side), FORMAT, usage);
            descriptor.size.depth_or_array_layers = layers as u32;
            gpu.device.create_texture(&descriptor)
        };
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("sky"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let split_sum = texture("split sum", SPLIT_SUM_SIDE - 2, 1);
        let two = |[a, b]: &[f64; 2]| DVec3::new(*a, *b, 0.0);
        write(gpu, &split_sum, 0, split_sum_once().iter().map(two), SPLIT_SUM_SIDE);
        Self {
            split_sum,
            seen: texture("sky", SEEN_SIDE, 1),
            lobes: texture("sky lobes", LOBE_SIDE, LOBES),
            sampler,
            air: None,
            maps: None,
            #[cfg(test)]
            computed: 0,
        }
    }

    /// Memory of the maps, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        [&self.seen, &self.lobes, &self.split_sum].map(texture_bytes).iter().sum()
    }

    /// The light of an environment. Uploads its maps if they have changed, and computes them if `given` holds other
    /// ones.
    pub(crate) fn light(
        &mut self,
        gpu: &Gpu,
        environment: &Environment,
        computed: Option<&SkyMaps>,
    ) -> SkyLight {
        let SunPlace { to_sun, up, side, .. } = SunPlace::new(environment);
        let key = Key::new(environment);
        if self.maps.as_ref().is_none_or(|last| !last.are_of(&key)) {
            let maps = computed.filter(|maps| maps.are_of(&key)).cloned();
            let maps = maps.unwrap_or_else(|| self.compute(key));
            self.upload(gpu, maps.map());
            self.maps = Some(maps);
        }
        let four = |v: DVec3, w: f32| v.as_vec3().extend(w).to_array();
        let map = self.maps.as_ref().map(SkyMaps::map);
        let (sun, disc, irradiance) =
            map.map_or_else(Default::default, |map| (map.sun, map.disc, map.irradiance));
        SkyLight {
            to_sun,
            up,
            side,
            sun: sun.as_vec3(),
            disc: four(disc, SUN_RADIUS as f32),
            irradiance: irradiance.map(|c| four(c, 0.0)),
            haze: environment.haze.map_or(0.0, |haze| haze.extinction()) as f32,
        }
    }

    /// The maps of the last frame.
    #[cfg(test)]
    pub(crate) fn map(&self) -> Option<&SkyMap> {
        self.maps.as_ref().map(SkyMaps::map)
    }

    /// Views for bindings 10, 11 and 13 of `sky.wgsl`: radiance, prefiltered reflections, split sum.
    pub(crate) fn views(&self) -> [wgpu::TextureView; 3] {
        [&self.seen, &self.lobes, &self.split_sum].map(|texture| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(if texture.depth_or_array_layers() > 1 {
                    wgpu::TextureViewDimension::D2Array
                } else {
                    wgpu::TextureViewDimension::D2
                }),
                ..Default::default()
            })
        })
    }

    /// Sampler for binding 12.
    pub(crate) fn sampler(&self) -> &wgpu::Sampler {
        &self.sampler
    }

    fn compute(&mut self, key: Key) -> SkyMaps {
        #[cfg(test)]
        {
            self.computed += 1;
        }
        SkyMaps::of(key, &mut self.air)
    }

    fn upload(&self, gpu: &Gpu, map: &SkyMap) {
        let write = |texture, layer, of: &Octahedral| {
            write(gpu, texture, layer, of.texels().iter().copied(), of.bordered_side());
        };
        write(&self.seen, 0, &map.seen);
        for (lobe, layer) in map.lobes.iter().zip(0..) {
            write(&self.lobes, layer, lobe);
        }
    }
}

/// The table, computed once per process.
pub(super) fn split_sum_once() -> &'static [[f64; 2]] {
    static TABLE: OnceLock<Vec<[f64; 2]>> = OnceLock::new();
    TABLE.get_or_init(split_sum)
}

/// Writes rows of `side` texels into a layer.
fn write(gpu: &Gpu, texture: &wgpu::Texture, layer: u32, texels: impl Iterator<Item = DVec3>, side: usize) {
    let four = |texel: DVec3| {
        let [r, g, b] = texel.to_array().map(f16::from_f64);
        [r, g, b, f16::ONE]
    };
    let (texels, side): (Vec<[f16; 4]>, _) = (texels.map(four).collect(), side as u32);
    gpu.queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: 0,
            origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
            aspect: wgpu::TextureAspect::All,
        },
        bytemuck::cast_slice(&texels),
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(side * 8), rows_per_image: Some(side) },
        wgpu::Extent3d { width: side, height: side, depth_or_array_layers: 1 },
    );
}
