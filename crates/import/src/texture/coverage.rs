//! Coverage-preserving mip levels of alpha-tested textures (Castaño, "Computing alpha mipmaps", 2010).
//!
//! Averaged opacity passes the alpha test more or less often than the finest level, so leaves grow thin with distance.
//! Each level's opacity is scaled so that the same share of texels passes. The scale comes from a histogram instead of a
//! search, and applies to the unscaled means, so that errors do not accumulate over levels.

use super::error::TextureError;
use super::mip::{Halving, Plain};
use super::pyramid::level_sizes;
use super::rows::Rows;
use super::source::{Opacity, Transparency};
use super::strips::STRIP_ROWS;

/// Threshold where a file does not say one.
const USUAL_THRESHOLD: u8 = 128;

/// Number of a level's texels of each opacity.
struct Histogram([u64; 256]);

/// Opacity of a texture's levels, fine first.
pub(super) struct Opacities(Vec<Histogram>);

/// Scales of the levels' opacity.
pub(super) struct Coverage {
    /// The least opacity that passes.
    threshold: u8,
    /// For each level, fine first, the opacity that becomes the threshold.
    from: Vec<u8>,
}

impl Opacities {
    /// Reads an image; it is left at its end.
    pub(super) fn read(rows: &mut Rows) -> Result<Self, TextureError> {
        let mut levels: Vec<_> =
            level_sizes(rows.size()).map(|size| (Halving::<1>::new(size), Histogram([0; 256]))).collect();
        loop {
            let strip = rows.next(STRIP_ROWS)?.to_rgba8();
            if strip.is_empty() {
                break;
            }
            let mut samples: Vec<[u16; 1]> = strip.pixels().map(|p| [u16::from(p.0[3]) * 257]).collect();
            for (halving, Histogram(counts)) in &mut levels {
                for [sample] in &samples {
                    counts[((u32::from(*sample) + 128) / 257) as usize] += 1;
                }
                samples = halving.push::<Plain>(&samples);
            }
        }
        Ok(Self(levels.into_iter().map(|(_, histogram)| histogram).collect()))
    }

    pub(super) fn transparency(&self) -> Transparency {
        let Some(Histogram(counts)) = self.0.first() else { return Transparency::None };
        let all: u64 = counts.iter().sum();
        let between: u64 = counts[32..224].iter().sum();
        match counts[255] == all {
            true => Transparency::None,
            false if between * 10 <= all => Transparency::Holes,
            false => Transparency::Graded,
        }
    }

    /// Scales that keep the finest level's coverage, where opacity is tested.
    pub(super) fn coverage(&self, used: Opacity) -> Option<Coverage> {
        let threshold = match used {
            Opacity::Tested(threshold) => threshold,
            Opacity::Guessed if self.transparency() == Transparency::Holes => USUAL_THRESHOLD,
            _ => return None,
        };
        let finest = self.0.first()?;
        Some(Coverage {
            threshold,
            from: self.0.iter().map(|level| level.scaled_to(threshold, finest)).collect(),
        })
    }
}

impl Histogram {
    /// The opacity to scale to the threshold: the one with the nearest count of texels above it; on a tie the one nearest
    /// to the threshold. The finest level's is the threshold.
    fn scaled_to(&self, threshold: u8, finest: &Self) -> u8 {
        let passing: u64 = finest.0[usize::from(threshold)..].iter().sum();
        let (texels, of): (u64, u64) = (self.0.iter().sum(), finest.0.iter().sum());
        let wanted = (passing * texels + of / 2) / of.max(1);
        let mut above = 0;
        let mut best = (u64::MAX, u8::MAX, threshold);
        for alpha in (1..=u8::MAX).rev() {
            above += self.0[usize::from(alpha)];
            best = best.min((above.abs_diff(wanted), alpha.abs_diff(threshold), alpha));
        }
        best.2
    }
}

impl Coverage {
    /// Scales the opacity of texels of a level, counted from the finest.
    pub(super) fn restore(&self, level: usize, rgba: &mut [u8]) {
        let from = self.from.get(level).copied().unwrap_or(self.threshold);
        if from == self.threshold || self.threshold == 0 {
            return;
        }
        for [.., alpha] in rgba.as_chunks_mut::<4>().0 {
            // Rounded down, so that texels below the threshold stay below.
            let scaled = u32::from(*alpha) * u32::from(self.threshold) / u32::from(from);
            *alpha = scaled.min(255) as u8;
        }
    }
}
