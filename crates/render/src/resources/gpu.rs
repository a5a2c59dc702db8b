//! The graphics device: choice of adapter, limits, and errors as values.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use thiserror::Error;

/// Errors of the renderer.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RenderError {
    /// No graphics adapter answered.
    #[error(
        "no graphics adapter found ({reason}); install a Vulkan driver, without a GPU Mesa's software \
         one (Debian and Ubuntu: apt-get install mesa-vulkan-drivers libvulkan1)"
    )]
    NoAdapter {
        /// wgpu's message.
        reason: String,
    },
    /// The adapter refused to open a device.
    #[error("graphics adapter {adapter} refused to open a device: {reason}")]
    NoDevice {
        /// Name of the adapter.
        adapter: String,
        /// wgpu's message.
        reason: String,
    },
    /// wgpu reported an error since the last frame: out of memory, validation or a lost device.
    #[error("graphics device: {0}")]
    Device(String),
    /// A buffer or picture would exceed what the device can hold.
    #[error("{what} needs {needed}, the graphics device allows {allowed}")]
    TooLarge {
        /// The object.
        what: &'static str,
        /// Size asked for (bytes, or pixels on a side).
        needed: u64,
        /// The device's limit in the same unit.
        allowed: u64,
    },
    /// A material, texture or level number that the asset does not have.
    #[error("{what} {index} does not exist (there are {count})")]
    NoSuch {
        /// Kind of object.
        what: &'static str,
        /// The given index.
        index: usize,
        /// Their number.
        count: usize,
    },
    /// The pixels handed in do not fit the texture level.
    #[error("texture level {level}: expected {expected} samples ({width}×{height}), got {got}")]
    LevelSize {
        /// Mip level, 0 = coarsest.
        level: u32,
        /// Width of that level in texels.
        width: u32,
        /// Height of that level in texels.
        height: u32,
        /// Samples expected.
        expected: usize,
        /// Samples handed in.
        got: usize,
    },
    /// The pixels handed in do not fit the tile's image.
    #[error("tile {column}, {row} of texture level {level}: expected {width}×{height} samples, got {got}")]
    TileSize {
        /// Mip level, 0 = coarsest.
        level: u32,
        /// Column of the tile.
        column: u32,
        /// Row of the tile.
        row: u32,
        /// Width of its image in texels, with borders.
        width: u32,
        /// Height of its image in texels, with borders.
        height: u32,
        /// Samples handed in.
        got: usize,
    },
    /// A texture that no asset has yet has no memory for tiles.
    #[error("the texture belongs to no renderer; create an asset with it before its tiles are set")]
    NoTilePool,
    /// All pages have a tile.
    #[error("texture tiles have used up their {budget_bytes} bytes; remove some, or set a larger budget")]
    NoTileRoom {
        /// The budget in bytes.
        budget_bytes: u64,
    },
    /// A host's view cannot be drawn into.
    #[error("target: {0}")]
    Target(String),
    /// A terrain cannot be made.
    #[error("terrain: {0}")]
    Terrain(String),
    /// A picture could not be read back or written.
    #[error("picture: {0}")]
    Picture(String),
}

/// An open graphics device.
///
/// Cloning shares the device. Errors of wgpu (which by default abort the process) are logged and
/// kept; [`Gpu::take_error`] hands them over, and drawing returns them as [`RenderError::Device`].
#[derive(Clone, Debug)]
pub struct Gpu {
    /// The adapter behind the device.
    pub adapter: wgpu::Adapter,
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    error: Arc<Mutex<Option<String>>>,
    /// Whether a software driver draws on the CPU.
    software: bool,
    /// Render pipelines that were compiled.
    pipelines: Arc<AtomicU32>,
    /// Texts of the shader modules that were compiled.
    #[cfg(any(test, feature = "reference"))]
    shaders: Arc<Mutex<std::collections::BTreeSet<&'static str>>>,
}

impl Gpu {
    /// Features that the renderer uses where the device has them.
    pub const WANTED_FEATURES: wgpu::Features = wgpu::Features::POLYGON_MODE_LINE
        .union(wgpu::Features::TEXTURE_FORMAT_16BIT_NORM)
        .union(wgpu::Features::TIMESTAMP_QUERY)
        .union(wgpu::Features::INDIRECT_FIRST_INSTANCE);

    /// Opens a device that draws into textures only; needs no display. Prefers real GPUs to
    /// software ones; the environment variable `WGPU_BACKEND` restricts the back ends tried.
    ///
    /// # Errors
    /// [`RenderError::NoAdapter`] names the package to install.
    pub fn headless() -> Result<Self, RenderError> {
        Self::headless_on(wgpu::Backends::from_env().unwrap_or(wgpu::Backends::PRIMARY))
    }

    fn headless_on(backends: wgpu::Backends) -> Result<Self, RenderError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends,
            flags: wgpu::InstanceFlags::empty(),
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        Self::open(&instance, None)
    }

    /// Opens a device that can present to `surface`, which must come from `instance`.
    ///
    /// # Errors
    /// [`RenderError::NoAdapter`] names the package to install.
    pub fn for_surface(instance: &wgpu::Instance, surface: &wgpu::Surface<'_>) -> Result<Self, RenderError> {
        Self::open(instance, Some(surface))
    }

    /// Uses a host program's device. Needs no feature or limit beyond WebGPU's defaults; [`Gpu::WANTED_FEATURES`] add
    /// wireframes, 16-bit height maps, timing of passes on the device and calls that draw many meshes.
    ///
    /// The host's error handlers stay in place: wgpu reports errors to them, and [`Gpu::take_error`] returns none.
    #[must_use]
    pub fn from_parts(adapter: wgpu::Adapter, device: wgpu::Device, queue: wgpu::Queue) -> Self {
        Self::of(adapter, device, queue, Arc::default())
    }

    fn open(instance: &wgpu::Instance, surface: Option<&wgpu::Surface<'_>>) -> Result<Self, RenderError> {
        pollster::block_on(Self::request(instance, surface))
    }

    /// As [`Gpu::for_surface`], without blocking: a browser opens devices asynchronously.
    ///
    /// # Errors
    /// No adapter or device.
    pub async fn request(
        instance: &wgpu::Instance,
        surface: Option<&wgpu::Surface<'_>>,
    ) -> Result<Self, RenderError> {
        let request = instance.request_adapter(&wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            compatible_surface: surface,
            ..Default::default()
        });
        let adapter = request.await.map_err(|e| RenderError::NoAdapter { reason: e.to_string() })?;
        let info = adapter.get_info();
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("lodestream"),
            required_features: Self::WANTED_FEATURES & adapter.features(),
            required_limits: adapter.limits(),
            ..Default::default()
        });
        let (device, queue) = request
            .await
            .map_err(|e| RenderError::NoDevice { adapter: info.name.clone(), reason: e.to_string() })?;
        tracing::info!(adapter = info.name, backend = ?info.backend, "graphics device opened");

        let error = Arc::new(Mutex::new(None));
        let keep = |slot: &Arc<Mutex<Option<String>>>| {
            let slot = Arc::clone(slot);
            move |text: String| {
                tracing::error!("graphics device: {text}");
                // The first error explains the ones that follow it.
                slot.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(text);
            }
        };
        let on_error = keep(&error);
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| on_error(e.to_string())));
        let (on_lost, destroyed) = (keep(&error), Arc::clone(&error));
        device.set_device_lost_callback(move |reason, text| {
            let text = format!("device lost: {text}");
            if reason == wgpu::DeviceLostReason::Destroyed {
                // Usually by its owner, who does not ask any more; a browser may do it too.
                destroyed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(text);
            } else {
                on_lost(text);
            }
        });
        Ok(Self::of(adapter, device, queue, error))
    }

    fn of(
        adapter: wgpu::Adapter,
        device: wgpu::Device,
        queue: wgpu::Queue,
        error: Arc<Mutex<Option<String>>>,
    ) -> Self {
        Self {
            software: adapter.get_info().device_type == wgpu::DeviceType::Cpu,
            adapter,
            device,
            queue,
            error,
            pipelines: Arc::default(),
            #[cfg(any(test, feature = "reference"))]
            shaders: Arc::default(),
        }
    }

    /// Compiles a shader module from WGSL.
    pub(crate) fn shader(&self, label: &str, text: &'static str) -> wgpu::ShaderModule {
        #[cfg(any(test, feature = "reference"))]
        self.shaders.lock().unwrap_or_else(PoisonError::into_inner).insert(text);
        self.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(label),
            source: wgpu::ShaderSource::Wgsl(text.into()),
        })
    }

    /// WGSL texts of all shader modules that were compiled on this device, in the order of their bytes.
    #[cfg(any(test, feature = "reference"))]
    #[must_use]
    pub fn shader_texts(&self) -> Vec<&'static str> {
        self.shaders.lock().unwrap_or_else(PoisonError::into_inner).iter().copied().collect()
    }

    /// Compiles a pipeline, which takes milliseconds: a frame should not wait for it ([`crate::Compiler`]).
    pub(crate) fn render_pipeline(
        &self,
        descriptor: &wgpu::RenderPipelineDescriptor<'_>,
    ) -> wgpu::RenderPipeline {
        self.pipelines.fetch_add(1, Ordering::Relaxed);
        self.device.create_render_pipeline(descriptor)
    }

    /// Number of render pipelines compiled on this device.
    #[must_use]
    pub fn compiled_pipelines(&self) -> u32 {
        self.pipelines.load(Ordering::Relaxed)
    }

    /// Whether a software driver draws on the CPU, where costs differ from a GPU's.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.software
    }

    /// The device as one of a software driver, for hosts that know more than the adapter tells: browsers hide it.
    #[must_use]
    pub fn as_software(self) -> Self {
        Self { software: true, ..self }
    }

    /// Whether samplers filter anisotropically. Software drivers may, but more slowly than the shaders' own lookups.
    pub(crate) fn has_anisotropic_filter(&self) -> bool {
        let filters = wgpu::DownlevelFlags::ANISOTROPIC_FILTERING;
        !self.is_software() && self.adapter.get_downlevel_capabilities().flags.contains(filters)
    }

    /// Whether PN triangles are supported: storage buffers in compute and vertex stages, and indirect draws.
    pub(crate) fn can_curve(&self) -> bool {
        let needed = wgpu::DownlevelFlags::COMPUTE_SHADERS
            | wgpu::DownlevelFlags::VERTEX_STORAGE
            | wgpu::DownlevelFlags::INDIRECT_EXECUTION;
        let limits = self.device.limits();
        // Nothing needs it without the feature `methods`.
        cfg!(any(test, feature = "methods"))
            && self.adapter.get_downlevel_capabilities().flags.contains(needed)
            && limits.max_compute_invocations_per_workgroup >= 64
            && limits.max_storage_buffers_per_shader_stage >= 7
            && limits.max_bind_groups >= 4
    }

    /// Whether ink is supported: the needs of PN triangles, and workgroups of 256.
    pub(crate) fn can_ink(&self) -> bool {
        let limits = self.device.limits();
        self.can_curve()
            && limits.max_compute_invocations_per_workgroup >= 256
            && limits.max_compute_workgroup_size_x >= 256
    }

    /// Additional usages of vertex, index and instance buffers, which PN triangles and ink read.
    pub(crate) fn curve_usage(&self) -> wgpu::BufferUsages {
        if self.can_curve() { wgpu::BufferUsages::STORAGE } else { wgpu::BufferUsages::empty() }
    }

    /// Whether one call draws many meshes. Browsers split such calls, at more cost than single draws.
    pub(crate) fn draws_indirectly(&self) -> bool {
        let flags = self.adapter.get_downlevel_capabilities().flags;
        cfg!(not(target_family = "wasm"))
            && self.device.features().contains(wgpu::Features::INDIRECT_FIRST_INSTANCE)
            && flags.contains(wgpu::DownlevelFlags::INDIRECT_EXECUTION)
    }

    /// Anisotropy of samplers.
    pub(crate) fn anisotropy_clamp(&self) -> u16 {
        if self.has_anisotropic_filter() { 8 } else { 1 }
    }

    /// Name and back end of the adapter, for logs and overlays.
    #[must_use]
    pub fn describe(&self) -> String {
        let info = self.adapter.get_info();
        format!("{} ({:?})", info.name, info.backend)
    }

    /// The first error that wgpu reported since the last call.
    #[must_use]
    pub fn take_error(&self) -> Option<String> {
        self.error.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// [`Gpu::take_error`] as a result.
    pub(crate) fn check(&self) -> Result<(), RenderError> {
        self.take_error().map_or(Ok(()), |text| Err(RenderError::Device(text)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_an_adapter_the_message_names_the_package() {
        let error = Gpu::headless_on(wgpu::Backends::empty()).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("apt-get install mesa-vulkan-drivers libvulkan1"), "{text}");
        assert!(!text.contains('\n'), "{text}");
    }
}
