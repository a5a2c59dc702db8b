//! The sky: atmosphere model, its maps, and their use on the device.

mod atmosphere;
mod gpu;
mod luminance;
mod map;
mod maps;
mod octahedral;
mod prefilter;
mod studio;
mod table;

pub(crate) use gpu::{SkyGpu, SkyLight};
pub use maps::SkyMaps;
#[cfg(test)]
pub(crate) use octahedral::Octahedral;
#[cfg(test)]
pub(crate) use prefilter::{SPLIT_SUM_SIDE, ambient, environment_brdf_exact, split_sum};
#[cfg(test)]
pub(crate) use studio::background as studio_background;
#[cfg(any(test, feature = "client"))]
pub(crate) use studio::white as studio_white;

/// Computes the tables that every program shares.
pub(crate) fn compute_tables() {
    maps::default_atmosphere();
    gpu::split_sum_once();
}

#[cfg(test)]
mod tests;
