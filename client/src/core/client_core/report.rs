//! Counters and progress, for overlays, reports and tests.

use std::collections::BTreeMap;

use lodestream_scene::blob::BlobId;
use lodestream_select::{Counters, Selection};

use super::ClientCore;
use super::source::Source;
use crate::core::milestones::Milestones;
use crate::core::stats::{Connection, MAX_LACKING, Received, Stats};

impl ClientCore {
    /// Transport payload received over all connections so far, handshakes included.
    #[must_use]
    pub const fn received_bytes(&self) -> u64 {
        self.connection.earlier_bytes + self.connection.transport_bytes
    }

    /// Whether the picture is as sharp as target and budgets allow, and no blob is pending or missing.
    #[must_use]
    pub fn is_settled(&self) -> bool {
        self.nothing_is_pending() && self.missing_in_view().next().is_none()
    }

    /// Blobs that the view needs and that stay missing because they are damaged or the server refuses them. Empty while
    /// other blobs are pending.
    pub fn lacking_blobs(&self) -> impl Iterator<Item = BlobId> {
        self.nothing_is_pending().then(|| self.missing_in_view()).into_iter().flatten()
    }

    fn missing_in_view(&self) -> impl Iterator<Item = BlobId> {
        self.selection.failed.iter().copied().filter(|id| self.failures.is_missing(*id))
    }

    fn nothing_is_pending(&self) -> bool {
        self.scene.is_complete()
            && !self.selection.stale
            && self.counters().settled
            && self.selection.terrain_settled
            && self.selection.punctual_lights_settled
            && self.selection.animations_settled
            && self.undecoded.is_empty()
            && !self.selection.failed.iter().any(|id| self.failures.is_retrying(*id))
    }

    /// Counters of the last selection.
    #[must_use]
    pub const fn counters(&self) -> &Counters {
        &self.selection.selector.last().counters
    }

    /// The number of selections so far, and the last one.
    #[must_use]
    pub const fn last_selection(&self) -> (u64, &Selection) {
        (self.counts.selections, self.selection.selector.last())
    }

    /// Received and used bytes of each blob; of cancelled blobs, only complete ones count. Empty unless
    /// [`Config::track_received`](crate::core::Config::track_received) is set.
    #[must_use]
    pub const fn received(&self) -> &BTreeMap<BlobId, Received> {
        &self.received
    }

    /// The milestones so far.
    #[must_use]
    pub const fn milestones(&self) -> &Milestones {
        &self.milestones
    }

    /// [`Stats::decoded_faces`], at no cost.
    #[must_use]
    pub const fn decoded_faces(&self) -> u64 {
        self.counts.decoded_faces
    }

    /// All counters. Costs a pass over the assets.
    #[must_use]
    pub fn stats(&self) -> Stats {
        let connection = match (&self.connection.session, &self.connection.closed, &self.connection.welcome) {
            (_, Some(close), _) => Connection::Closed(close.reason.clone()),
            (None, None, _) => Connection::None,
            (Some(_), None, None) => Connection::Opening,
            (Some(_), None, Some(_)) => Connection::Open,
        };
        let mut stats = Stats {
            scene: self.scene.header.as_ref().map(|h| h.name.clone()).unwrap_or_default(),
            connection,
            rate_bits_per_s: self
                .connection
                .welcome
                .as_ref()
                .map(|w| w.rate_bits_per_s)
                .filter(|rate| *rate > 0),
            counters: *self.counters(),
            session: self.connection.session.as_ref().map(Source::stats).unwrap_or_default(),
            requests: self.connection.earlier_requests
                + self.connection.session.as_ref().map_or(0, Source::requests),
            milestones: self.milestones,
            transport_bytes: self.received_bytes(),
            assets: self.scene.asset_count(),
            instances: u32::try_from(self.scene.instances().all().len()).unwrap_or(u32::MAX),
            scene_instances: self.scene.header.as_ref().map_or(0, |h| h.instance_count),
            wanted_chunks: u64::from(self.counters().missing_chunks),
            texture_levels: self.counts.texture_levels,
            cached_bytes: self.cache.bytes(),
            undone: self.counts.undone,
            decoded_faces: self.counts.decoded_faces,
            decode_failures: self.counts.decode_failures,
            evicted: self.counts.evicted,
            refused: self.counts.refused,
            selections: self.counts.selections,
            connections: self.counts.connections,
            settled: self.is_settled(),
            lacking_blobs: self.lacking_blobs().count() as u64,
            lacking: self.lacking_blobs().take(MAX_LACKING).collect(),
            settled_after: self.counts.settled_after,
            ..Stats::default()
        };
        for refined in self.scene.refined.iter().flatten() {
            stats.faces += refined.mesh().face_count() as u64;
            stats.vertices += refined.mesh().vertex_count() as u64;
            stats.applied_chunks += refined.mesh().applied_count() as u64;
            stats.mesh_bytes += refined.mesh().bytes() as u64;
        }
        stats
    }
}
