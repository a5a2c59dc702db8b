//! Pages of a scene's description: assets with their instances and proxies.

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
    /// Numbers of the instances' assets.
    numbers: BTreeMap<u32, u32>,
}

impl Pages {
    /// The last page, or a new one where `is_full` says so.
    fn page(&mut self, is_full: impl Fn(&ScenePage) -> bool) -> &mut ScenePage {
        if self.pages.last().is_none_or(is_full) {
            let next = self.pages.last().map_or_else(ScenePage::default, |last| ScenePage {
                page: last.page + 1,
                first_asset: self.asset_order.len() as u32,
                first_instance: last.first_instance + last.instances.len() as u32,
                first_proxy: last.first_proxy + last.proxies.len() as u32,
                ..ScenePage::default()
            });
            self.pages.push(next);
        }
        let last = self.pages.len() - 1;
        &mut self.pages[last]
    }

    /// Adds proxies and the instances, which are given in the order of their numbers. A proxy precedes its children, which
    /// follow each other, and what is below one precedes what is below the next: a client that draws the first leaf itself
    /// needs no proxies but those on the way to it. The order of the proxies is that of their instances; asset `i` of a
    /// proxy has the entry `of_proxies[i]` and is asset `entries.len() + i` of the scene.
    pub(super) fn add_forest(
        &mut self,
        proxies: &[Proxy],
        of_proxies: &[AssetEntry],
        instances: &[Instance],
        entries: &[AssetEntry],
        order: &[usize],
    ) {
        let mut below: Vec<Vec<usize>> = vec![Vec::new(); proxies.len()];
        let mut roots = Vec::new();
        for (number, proxy) in proxies.iter().enumerate() {
            proxy.parent().map_or(&mut roots, |parent| &mut below[parent as usize]).push(number);
        }
        let mut numbers = vec![0; proxies.len()];
        let mut count = 0;
        let mut add = |pages: &mut Self, list: &[usize]| {
            for &old in list {
                count += 1;
                numbers[old] = count;
                let proxy = proxies[old];
                let parent = proxy.parent().map_or(0, |parent| numbers[parent as usize]);
                pages.add_proxy(
                    &Proxy { parent, ..proxy },
                    &of_proxies[proxy.asset as usize],
                    entries.len() + proxy.asset as usize,
                );
            }
        };
        add(self, &roots);
        roots.reverse();
        let mut open = roots;
        while let Some(proxy) = open.pop() {
            let children = &below[proxy];
            add(self, children);
            open.extend(children.iter().rev());
            // The children of a proxy divide its instances (`proxies::tree`).
            if children.is_empty() {
                let [first, end] =
                    [proxies[proxy].instances().start, proxies[proxy].instances().end].map(|at| at as usize);
                self.add_instances(instances, entries, &order[first..end]);
            }
        }
    }

    fn add_proxy(&mut self, proxy: &Proxy, entry: &AssetEntry, asset: usize) {
        let number = self.asset_order.len() as u32;
        let page = self.page(|page| {
            let most = if page.page == 0 { FIRST_PROXIES } else { MAX_ENTRIES_PER_PAGE };
            page.proxies.len() >= most || page.assets.len() >= MAX_ENTRIES_PER_PAGE
        });
        page.proxies.push(Proxy { asset: number, ..*proxy });
        page.assets.push(entry.clone());
        self.asset_order.push(asset);
    }

    /// Adds instances in the given order; a page lists the assets that it is the first to use. A first page with proxies
    /// has no instances.
    pub(super) fn add_instances(&mut self, instances: &[Instance], entries: &[AssetEntry], order: &[usize]) {
        for &index in order {
            let instance = &instances[index];
            let known = self.numbers.get(&instance.asset).copied();
            let number = known.unwrap_or(self.asset_order.len() as u32);
            let page = self.page(|page| {
                page.instances.len() >= MAX_ENTRIES_PER_PAGE
                    || known.is_none() && page.assets.len() >= MAX_ENTRIES_PER_PAGE
                    || page.page == 0 && !page.proxies.is_empty()
            });
            page.instances.push(Instance { asset: number, ..*instance });
            if known.is_none() {
                page.assets.push(entries[instance.asset as usize].clone());
                self.numbers.insert(instance.asset, number);
                self.asset_order.push(instance.asset as usize);
            }
        }
    }
}
