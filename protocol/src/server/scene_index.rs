//! Index of a scene's description: its pages, and the bounding volume hierarchy of its instances. Sessions share it.

use std::sync::Arc;

use crate::source::SceneSource;
use lodestream_scene::description::{AssetEntry, Instance, ScenePage};
use lodestream_scene::proxy::Proxies;
use lodestream_select::{InstanceTree, Projection, RootError};

/// A scene's pages with lookup of assets and instances by number and by view.
#[derive(Debug)]
pub(super) struct SceneIndex {
    pages: Vec<Arc<ScenePage>>,
    /// Number of the first instance of each page.
    first_instances: Vec<u32>,
    /// Estimated bytes of each page and all before it.
    page_ends: Vec<u64>,
    /// Page of each asset, and index there.
    assets: Vec<(u32, u32)>,
    tree: InstanceTree,
    proxies: Proxies,
    /// Page of each proxy.
    proxy_pages: Vec<u32>,
    instance_count: usize,
    /// Errors of the roots, if they are made for the start camera.
    root_error: Option<RootError>,
}

impl SceneIndex {
    /// Reads all pages of a scene.
    pub(super) fn new(source: &dyn SceneSource) -> Self {
        let pages: Vec<Arc<ScenePage>> =
            (0..source.header().page_count).map_while(|page| source.page(page)).collect();
        let counts =
            (0..).zip(&pages).map(|(page, of)| (page, u32::try_from(of.assets.len()).unwrap_or(u32::MAX)));
        let assets = counts.flat_map(|(page, count)| (0..count).map(move |at| (page, at))).collect();
        let first_instances = pages.iter().scan(0, |next: &mut u32, page| {
            let first = *next;
            *next = first.saturating_add(u32::try_from(page.instances.len()).unwrap_or(u32::MAX));
            Some(first)
        });
        let first_instances = first_instances.collect();
        let page_ends = pages.iter().scan(0, |end: &mut u64, page| {
            *end += estimated_page_bytes(page);
            Some(*end)
        });
        let page_ends = page_ends.collect();
        let instance_count = pages.iter().map(|page| page.instances.len()).sum();
        let mut index = Self {
            pages,
            first_instances,
            page_ends,
            assets,
            tree: InstanceTree::default(),
            proxies: Proxies::default(),
            proxy_pages: Vec::new(),
            instance_count,
            root_error: RootError::new(&source.header().camera, source.header().root_slope),
        };
        index.add_proxies();
        let instances = index.pages.iter().flat_map(|page| &page.instances);
        index.tree = InstanceTree::new(instances, |asset| index.asset(asset));
        index
    }

    /// Errors of the roots, if they are made for the start camera.
    pub(super) const fn root_error(&self) -> Option<&RootError> {
        self.root_error.as_ref()
    }

    /// Reads the proxies, up to the first that does not fit.
    fn add_proxies(&mut self) {
        let known = |length: usize| u32::try_from(length).unwrap_or(u32::MAX);
        let (assets, instances) = (known(self.assets.len()), known(self.instance_count));
        for (number, page) in (0..).zip(&self.pages) {
            if self
                .proxies
                .add(page.first_proxy.max(self.proxies.len()), &page.proxies, assets, instances)
                .is_err()
            {
                break;
            }
            self.proxy_pages.resize(self.proxies.nodes().len(), number);
        }
    }

    /// The proxies.
    pub(super) const fn proxies(&self) -> &Proxies {
        &self.proxies
    }

    /// Number of the page of a proxy.
    pub(super) fn page_of_proxy(&self, proxy: u32) -> Option<u32> {
        self.proxy_pages.get(proxy as usize).copied()
    }

    /// Estimated bytes of a page and all before it.
    pub(super) fn bytes_to_page(&self, page: u32) -> u64 {
        self.page_ends.get(page as usize).copied().unwrap_or_default()
    }

    /// Number of instances.
    pub(super) const fn instance_count(&self) -> usize {
        self.instance_count
    }

    /// Number of pages.
    pub(super) const fn page_count(&self) -> usize {
        self.pages.len()
    }

    /// The assets, each with the number of its page.
    pub(super) fn assets(&self) -> impl ExactSizeIterator<Item = (u32, &AssetEntry)> {
        self.assets.iter().map(|&(page, at)| (page, &self.pages[page as usize].assets[at as usize]))
    }

    /// The asset entry of a number.
    pub(super) fn asset(&self, number: u32) -> Option<&AssetEntry> {
        let &(page, at) = self.assets.get(number as usize)?;
        Some(&self.pages[page as usize].assets[at as usize])
    }

    /// The instance entry of a number.
    pub(super) fn instance(&self, number: u32) -> Option<&Instance> {
        self.find(number).map(|(_, instance)| instance)
    }

    /// Number of the page of an instance.
    pub(super) fn page_of_instance(&self, number: u32) -> Option<u32> {
        self.find(number).map(|(page, _)| page)
    }

    /// The instance entry of a number, with the number of its page.
    fn find(&self, number: u32) -> Option<(u32, &Instance)> {
        let page = self.first_instances.partition_point(|&first| first <= number).checked_sub(1)?;
        let instance = self.pages[page].instances.get((number - self.first_instances[page]) as usize)?;
        Some((u32::try_from(page).ok()?, instance))
    }

    /// The instances that may be in view, as (instance number, page number, entry), by ascending number.
    /// Conservative: all visible ones and some others.
    pub(super) fn near(&self, projection: &Projection) -> Vec<(u32, u32, &Instance)> {
        let numbers = self.tree.in_view(projection);
        let with_page = |&number: &u32| self.find(number).map(|(page, instance)| (number, page, instance));
        numbers.iter().filter_map(with_page).collect()
    }

    /// The instance of an asset with the largest coverage on the screen, in view or not.
    pub(super) fn largest(&self, asset: u32, projection: &Projection) -> Option<(u32, &Instance)> {
        let entry = self.asset(asset)?;
        let radius_px =
            |number| self.instance(number).map_or(0.0, |instance| projection.coverage_px(entry, instance));
        let (number, _) = self.tree.largest(asset, projection, radius_px)?;
        Some((number, self.instance(number)?))
    }
}

/// About how many bytes a page takes, from typical lengths of entries.
pub(super) fn estimated_page_bytes(page: &ScenePage) -> u64 {
    8 + 80 * page.assets.len() as u64 + 20 * page.instances.len() as u64
}
