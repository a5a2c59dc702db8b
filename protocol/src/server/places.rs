//! What of a scene lies where: its description's pages and the hierarchy of its instances, for all sessions.

use std::sync::Arc;

use crate::source::SceneSource;
use lodestream_scene::description::{AssetEntry, InstanceEntry, ScenePage};
use lodestream_select::{InstanceTree, Projection};

/// See the module.
#[derive(Debug)]
pub(super) struct Places {
    pages: Vec<Arc<ScenePage>>,
    /// The first instance of each page.
    firsts: Vec<u32>,
    /// Page and place there of each asset.
    assets: Vec<(u32, u32)>,
    tree: InstanceTree,
}

impl Places {
    /// Reads all pages of a scene.
    pub(super) fn new(source: &dyn SceneSource) -> Self {
        let pages: Vec<Arc<ScenePage>> =
            (0..source.header().page_count).map_while(|page| source.page(page)).collect();
        let counts =
            (0..).zip(&pages).map(|(page, of)| (page, u32::try_from(of.assets.len()).unwrap_or(u32::MAX)));
        let assets = counts.flat_map(|(page, count)| (0..count).map(move |at| (page, at))).collect();
        let firsts = pages.iter().scan(0, |next: &mut u32, page| {
            let first = *next;
            *next = first.saturating_add(u32::try_from(page.instances.len()).unwrap_or(u32::MAX));
            Some(first)
        });
        let firsts = firsts.collect();
        let mut places = Self { pages, firsts, assets, tree: InstanceTree::default() };
        let instances = places.pages.iter().flat_map(|page| &page.instances);
        places.tree = InstanceTree::new(instances, |asset| places.asset(asset));
        places
    }

    /// How many pages there are.
    pub(super) const fn page_count(&self) -> usize {
        self.pages.len()
    }

    /// The assets, each with the number of its page.
    pub(super) fn assets(&self) -> impl ExactSizeIterator<Item = (u32, &AssetEntry)> {
        self.assets.iter().map(|&(page, at)| (page, &self.pages[page as usize].assets[at as usize]))
    }

    /// An asset.
    pub(super) fn asset(&self, number: u32) -> Option<&AssetEntry> {
        let &(page, at) = self.assets.get(number as usize)?;
        Some(&self.pages[page as usize].assets[at as usize])
    }

    /// An instance.
    fn instance(&self, number: u32) -> Option<&InstanceEntry> {
        self.find(number).map(|(_, instance)| instance)
    }

    /// An instance, with the number of its page.
    fn find(&self, number: u32) -> Option<(u32, &InstanceEntry)> {
        let page = self.firsts.partition_point(|&first| first <= number).checked_sub(1)?;
        let instance = self.pages[page].instances.get((number - self.firsts[page]) as usize)?;
        Some((u32::try_from(page).ok()?, instance))
    }

    /// The instances that may be in view, each with its number and that of its page, ascending: all that are, and some others.
    pub(super) fn near(&self, projection: &Projection) -> Vec<(u32, u32, &InstanceEntry)> {
        let numbers = self.tree.in_view(projection);
        let place = |&number: &u32| self.find(number).map(|(page, instance)| (number, page, instance));
        numbers.iter().filter_map(place).collect()
    }

    /// The instance of an asset that is largest on the screen, in view or not.
    pub(super) fn largest(&self, asset: u32, projection: &Projection) -> Option<(u32, &InstanceEntry)> {
        let entry = self.asset(asset)?;
        let radius_px = |number| self.instance(number).map_or(0.0, |it| projection.coverage_px(entry, it));
        let (number, _) = self.tree.largest(asset, projection, radius_px)?;
        Some((number, self.instance(number)?))
    }
}
