//! How much of an alpha-tested texture is there, kept in its coarser levels.
//!
//! Means of opacity pass the test more or less often than what they are means of, and leaves grow thin with distance.
//! Each level's opacity is scaled so that the same share passes (Castaño, "Computing alpha mipmaps", 2010). The scale is
//! found by counting instead of searching; it is taken of the mean itself, so that no error adds up over levels.

use image::RgbaImage;

/// The share of texels that pass a test.
pub(super) struct Coverage {
    /// The least opacity that passes.
    threshold: u8,
    passing: u64,
    texels: u64,
}

impl Coverage {
    /// That of the finest level.
    pub(super) fn of(rgba: &RgbaImage, threshold: u8) -> Self {
        let passing = rgba.pixels().filter(|p| p.0[3] >= threshold).count() as u64;
        Self { threshold, passing, texels: rgba.pixels().len() as u64 }
    }

    /// Scales the opacity of a level's texels. The finest comes out as it is.
    pub(super) fn restore(&self, rgba: &mut [u8]) {
        let texels = rgba.as_chunks_mut::<4>().0;
        let mut counts = [0u64; 256];
        for [.., alpha] in texels.iter() {
            counts[usize::from(*alpha)] += 1;
        }
        let wanted = (self.passing * texels.len() as u64 + self.texels / 2) / self.texels.max(1);
        // The opacity that must become the threshold: of those with about as many texels above, the nearest in count,
        // and of two alike the one that changes less.
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
            // Rounded down: what was below stays below.
            let scaled = u32::from(*alpha) * u32::from(self.threshold) / u32::from(from);
            *alpha = scaled.min(255) as u8;
        }
    }
}
