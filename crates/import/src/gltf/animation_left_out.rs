//! What of a file's animations does not play, for one warning.

use std::path::Path;

/// Counts of what does not play.
#[derive(Debug, Default)]
pub(super) struct LeftOut {
    /// Nodes with skins of which joints move.
    pub(super) skinned: usize,
    /// Lights on nodes that move.
    pub(super) lit: usize,
    /// Meshes on nodes that move, without volume or beyond the limit.
    pub(super) still: usize,
    /// Some are scaled unevenly or mirrored.
    pub(super) uneven: bool,
    /// Channels of weights of morph targets.
    pub(super) weights: usize,
    /// Channels of extensions.
    pub(super) others: usize,
    /// Channels that cannot be read.
    pub(super) unreadable: usize,
    /// Why the first cannot be read.
    pub(super) first: Option<String>,
    /// Something did not fit.
    pub(super) too_long: bool,
}

impl LeftOut {
    /// The warning; `None` if all plays.
    pub(super) fn warning(self, path: &Path) -> Option<String> {
        let first = self.first.unwrap_or_default();
        let counted = [
            (self.skinned, "skins (stand still): "),
            (self.weights, "channels of morph targets (ignored): "),
            (self.others, "channels of extensions (ignored): "),
            (self.lit, "lights (stand still): "),
            (self.still, "flat meshes, and those beyond the limit (stand still): "),
        ];
        let counted = counted.into_iter().filter(|(count, _)| *count > 0);
        let mut what: Vec<String> = counted.map(|(count, name)| format!("{name}{count}")).collect();
        if self.unreadable > 0 {
            what.push(format!("channels that cannot be read: {} (the first: {first})", self.unreadable));
        }
        if self.uneven {
            what.push("uneven or mirrored scales are made even".to_owned());
        }
        if self.too_long {
            what.push(
                "they are too long, or repeat their numbers too often: the rest is left out".to_owned(),
            );
        }
        (!what.is_empty()).then(|| format!("{}: animations: {}", path.display(), what.join("; ")))
    }
}
