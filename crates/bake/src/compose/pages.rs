//! Pages of a scene's description: first those of the proxies, then those of the instances.

use std::collections::BTreeMap;

use lodestream_scene::description::{AssetEntry, Instance, ScenePage};
use lodestream_scene::limits::MAX_ENTRIES_PER_PAGE;
use lodestream_scene::proxy::Proxy;

/// Most proxies of the first page: those of a first frame.
const FIRST_PROXIES: usize = 16;

/// Pages, and the scene's assets in the order in which the pages list them.
#[derive(Default)]
pub(super) struct Pages {
    pub(super) pages: Vec<ScenePage>,
    pub(super) asset_order: Vec<usize>,
}

impl Pages {
    /// An empty page behind the others, with `first_instance` instances and `first_proxy` proxies before it.
    fn next(&self, first_instance: usize, first_proxy: usize) -> ScenePage {
        ScenePage {
            page: self.pages.len() as u32,
            first_asset: self.asset_order.len() as u32,
            first_instance: first_instance as u32,
            first_proxy: first_proxy as u32,
            ..ScenePage::default()
        }
    }

    /// Adds pages of proxies and their assets, before any page of instances. Asset `i` of a proxy has the entry
    /// `entries[i]` and is asset `assets + i` of the scene.
    pub(super) fn add_proxies(&mut self, proxies: &[Proxy], entries: &[AssetEntry], assets: usize) {
        let (first, others) = proxies.split_at(FIRST_PROXIES.min(proxies.len()));
        let mut count = 0;
        for group in [first].into_iter().chain(others.chunks(MAX_ENTRIES_PER_PAGE)) {
            let mut page = self.next(0, count);
            for proxy in group {
                page.proxies.push(Proxy { asset: self.asset_order.len() as u32, ..*proxy });
                page.assets.push(entries[proxy.asset as usize].clone());
                self.asset_order.push(assets + proxy.asset as usize);
            }
            count += group.len();
            self.pages.push(page);
        }
    }

    /// Adds pages of the instances in the given order; a page lists the assets that it is the first to use.
    pub(super) fn add_instances(&mut self, instances: &[Instance], entries: &[AssetEntry], order: &[usize]) {
        let proxies = self.pages.iter().map(|page| page.proxies.len()).sum();
        let mut numbers: BTreeMap<u32, u32> = BTreeMap::new();
        for (number, group) in order.chunks(MAX_ENTRIES_PER_PAGE).enumerate() {
            let mut page = self.next(number * MAX_ENTRIES_PER_PAGE, proxies);
            for &index in group {
                let instance = &instances[index];
                let asset = *numbers.entry(instance.asset).or_insert_with(|| {
                    self.asset_order.push(instance.asset as usize);
                    page.assets.push(entries[instance.asset as usize].clone());
                    (self.asset_order.len() - 1) as u32
                });
                page.instances.push(Instance { asset, ..*instance });
            }
            self.pages.push(page);
        }
    }
}
