//! Which placements of assets are drawn in a scene with proxies.

use std::collections::{BTreeMap, BTreeSet};

use lodestream_scene::proxy::{Cut, PartialProxy, Proxy};

use crate::scene::part_states::{InstanceStates, PartState, PartStates};

/// Placements that the last cut draws, by asset. Those that it does not name are not drawn.
#[derive(Debug, Default)]
pub(crate) struct DrawnPlacements {
    /// Assets of the scene's proxies, by number.
    proxies: Vec<u32>,
    by_asset: BTreeMap<u32, BTreeSet<u32>>,
}

impl DrawnPlacements {
    /// Adds proxies; each is the only placement of its asset.
    pub(crate) fn add_proxies(&mut self, proxies: &[Proxy]) {
        self.proxies.extend(proxies.iter().map(|proxy| proxy.asset));
    }

    /// Takes a cut; `places` has the asset of each instance, and its index among the asset's placements. Cost: a pass over
    /// the instances.
    pub(crate) fn set_cut(&mut self, cut: &Cut, places: &[(u32, u32)]) {
        self.by_asset.clear();
        let mut covered = cut.covered.iter().peekable();
        for (number, &(asset, index)) in (0..cut.instances).zip(places) {
            while covered.next_if(|[_, end]| *end <= number).is_some() {}
            if covered.peek().is_none_or(|[first, _]| number < *first) {
                self.by_asset.entry(asset).or_default().insert(index);
            }
        }
        for &proxy in &cut.proxies {
            if let Some(&asset) = self.proxies.get(proxy as usize) {
                self.by_asset.entry(asset).or_default().insert(0);
            }
        }
    }

    /// The parts that assets of proxies are drawn without; of proxies whose meshes have parts that others stand for.
    pub(crate) fn hidden_parts(&self, cut: &Cut) -> BTreeMap<u32, PartStates> {
        let states = |partial: &PartialProxy| {
            let asset = *self.proxies.get(partial.proxy as usize)?;
            let parts = partial.hidden.iter().flat_map(|[first, end]| *first..*end);
            let parts = parts.map(|part| (part, PartState::HIDDEN)).collect();
            let instances = [(0, InstanceStates { parts, ..InstanceStates::default() })].into();
            Some((asset, PartStates { instances, ..PartStates::default() }))
        };
        cut.partial.iter().filter_map(states).collect()
    }

    /// The placements of an asset that are drawn; `None`, which means all, in a scene without proxies.
    pub(crate) fn of(&self, asset: u32) -> Option<BTreeSet<u32>> {
        (!self.proxies.is_empty()).then(|| self.by_asset.get(&asset).cloned().unwrap_or_default())
    }
}
