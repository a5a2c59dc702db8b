//! Coverage-preserving mip levels of alpha-tested textures (Castaño, "Computing alpha mipmaps", 2010).
//!
//! Averaged opacity passes the alpha test more or less often than the finest level, so leaves grow thin with distance.
//! Each level's opacity is scaled so that the same share of texels passes. The scale comes from a histogram instead of a
//! search, and applies to the unscaled means, so that errors do not accumulate over levels.

use image::RgbaImage;

/// The share of texels that pass a test.
pub(super) struct Coverage {
    /// The least opacity that passes.
    threshold: u8,
    passing: u64,
    texels: u64,
}

impl Coverage {
    /// Coverage of the finest level.
    pub(super) fn of(rgba: &RgbaImage, threshold: u8) -> Self {
        let passing = rgba.pixels().filter(|p| p.0[3] >= threshold).count() as u64;
        Self { threshold, passing, texels: rgba.pixels().len() as u64 }
    }

    /// Scales the opacity of a level's texels; leaves the finest level unchanged.
    pub(super) fn restore(&self, rgba: &mut [u8]) {
        let texels = rgba.as_chunks_mut::<4>().0;
        let mut counts = [0u64; 256];
        for [.., alpha] in texels.iter() {
            counts[usize::from(*alpha)] += 1;
        }
        let wanted = (self.passing * texels.len() as u64 + self.texels / 2) / self.texels.max(1);
        // The opacity to scale to the threshold: the one with the nearest count of texels above it; on a tie the one
        // nearest to the threshold.
        let mut above = 0;
        let mut best = (u64::MAX, u8::MAX, self.threshold);
        for alpha in (1..=u8::MAX).rev() {
            above += counts[usize::from(alpha)];
            let candidate = (above.abs_diff(wanted), alpha.abs_diff(self.threshold), alpha);
            best = best.min(candidate);
        }
        let (_, _, from) = best;
        if from == self.threshold || self.threshold == 0 {
            return;
        }
        for [.., alpha] in texels {
            // Rounded down, so that texels below the threshold stay below.
            let scaled = u32::from(*alpha) * u32::from(self.threshold) / u32::from(from);
            *alpha = scaled.min(255) as u8;
        }
    }
}
