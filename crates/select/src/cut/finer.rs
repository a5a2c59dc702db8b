//! What makes a cut finer: base meshes that replace a part of a proxy whose error is too large.
//!
//! Each replaces the proxy for what it stands for alone, so each has a priority of its own: the difference that the
//! proxy's error makes there, per byte. Wanted are the base meshes of the final cut; of a proxy between only if it is the
//! better bargain, so a near view does not fetch every level.

use std::collections::BTreeMap;

use lodestream_scene::description::{AssetEntry, Instance};
use lodestream_scene::proxy::Proxies;

use crate::difference::Picture;
use crate::priority::{Priority, refine_priority};
use crate::project::{Bounds, Projection};

/// What a scene consists of, and what of it a cut has.
pub trait Forest {
    /// The proxies.
    fn proxies(&self) -> &Proxies;
    /// An instance, if it is known.
    fn instance(&self, number: u32) -> Option<&Instance>;
    /// An asset, if it is known.
    fn entry(&self, asset: u32) -> Option<&AssetEntry>;
    /// Whether an asset's base mesh is to come.
    fn is_missing(&self, asset: u32) -> bool;
    /// Whether an asset's base mesh is there.
    fn is_there(&self, asset: u32) -> bool;
    /// Whether a proxy in view that errs by so many pixels must be replaced.
    fn must_open(&self, proxy: u32, error_px: f32) -> bool;
}

/// A proxy or an instance that is placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placed {
    /// Number of a proxy.
    Proxy(u32),
    /// Number of an instance.
    Instance(u32),
}

/// A base mesh that makes a cut finer.
#[derive(Clone, Copy, Debug)]
pub struct Finer {
    /// Number of the asset.
    pub asset: u32,
    /// The first of what is placed so.
    pub first: Placed,
    difference_px2: f32,
    bytes: u32,
    foveation: f32,
}

impl Finer {
    /// Priority of its request.
    #[must_use]
    pub fn priority(&self) -> Priority {
        #[expect(clippy::cast_precision_loss, reason = "a priority needs no more of a length than 24 bits")]
        refine_priority(self.difference_px2, self.bytes as f32, self.foveation)
    }

    /// The difference that it makes, in square pixels.
    #[must_use]
    pub const fn difference_px2(&self) -> f32 {
        self.difference_px2
    }

    /// Length of the base mesh.
    #[must_use]
    pub const fn bytes(&self) -> u32 {
        self.bytes
    }
}

/// The base meshes that make drawn proxies finer, by asset. Cost: a sphere test for each proxy and instance below them down
/// to the final cut.
pub fn finer(
    forest: &impl Forest,
    projection: &Projection,
    picture: &Picture,
    drawn: impl IntoIterator<Item = u32>,
) -> Vec<Finer> {
    let mut search = Search { forest, projection, picture, found: BTreeMap::new() };
    for number in drawn {
        let proxy = forest.proxies().nodes()[number as usize].proxy;
        if let Some(entry) = forest.entry(proxy.asset) {
            let drawn = Drawn { error: f64::from(proxy.error) + f64::from(entry.root_error) };
            search.below(number, drawn);
        }
    }
    search.found.into_values().collect()
}

/// A proxy that is drawn by its base mesh.
#[derive(Clone, Copy)]
struct Drawn {
    /// Largest error, in world units.
    error: f64,
}

/// What replaces a part of a drawn proxy.
#[derive(Clone, Copy, Default)]
struct Sum {
    difference_px2: f32,
    bytes: f32,
}

struct Search<'a, F> {
    forest: &'a F,
    projection: &'a Projection,
    picture: &'a Picture,
    found: BTreeMap<u32, Finer>,
}

impl<'a, F: Forest> Search<'a, F> {
    /// Difference that an error in world units makes.
    fn difference_px2(&self, error: f64, bounds: &Bounds) -> f32 {
        #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
        let error_px = self.projection.error_px(error, bounds.depth) as f32;
        self.picture.object_px2(error_px, bounds.coverage_px)
    }

    /// Adds what replaces the part of a drawn proxy that another proxy stands for.
    fn below(&mut self, number: u32, drawn: Drawn) -> Sum {
        let mut sum = Sum::default();
        let forest: &'a F = self.forest;
        let proxies = forest.proxies();
        for &child in &proxies.nodes()[number as usize].children {
            let proxy = &proxies.nodes()[child as usize].proxy;
            let Some(entry) = forest.entry(proxy.asset) else { continue };
            let bounds = self.projection.bounds_within(entry, proxy.error);
            // What is below one that is there makes that one finer.
            if !bounds.visible || forest.is_there(proxy.asset) {
                continue;
            }
            #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
            let error_px = self.projection.error_px(f64::from(proxy.error), bounds.depth) as f32;
            let base_error = f64::from(proxy.error) + f64::from(entry.root_error);
            let (before, after) =
                (self.difference_px2(drawn.error, &bounds), self.difference_px2(base_error, &bounds));
            if !forest.must_open(child, error_px) {
                sum = sum.with(self.add(proxy.asset, Placed::Proxy(child), before, &bounds));
                continue;
            }
            let below = self.below(child, drawn);
            #[expect(
                clippy::cast_precision_loss,
                reason = "a priority needs no more of a length than 24 bits"
            )]
            let own_bytes = entry.base_bytes as f32;
            let gain = before - after;
            if gain * below.bytes > below.difference_px2 * own_bytes {
                self.add(proxy.asset, Placed::Proxy(child), gain, &bounds);
            }
            sum = sum.with(below);
        }
        for instance in proxies.own_instances(number).into_iter().flatten() {
            let Some(of) = forest.instance(instance) else { continue };
            let Some(entry) = forest.entry(of.asset).filter(|_| forest.is_missing(of.asset)) else {
                continue;
            };
            let bounds = self.projection.bounds(entry, of);
            if bounds.visible {
                let difference_px2 = self.difference_px2(drawn.error, &bounds);
                sum = sum.with(self.add(of.asset, Placed::Instance(instance), difference_px2, &bounds));
            }
        }
        sum
    }

    /// Adds a use of a base mesh, whose bytes count once.
    fn add(&mut self, asset: u32, first: Placed, difference_px2: f32, bounds: &Bounds) -> Sum {
        if !self.forest.is_missing(asset) {
            return Sum::default();
        }
        let bytes = self.forest.entry(asset).map_or(0, |entry| entry.base_bytes);
        let new = Finer { asset, first, difference_px2: 0.0, bytes, foveation: 0.0 };
        let is_new = !self.found.contains_key(&asset);
        let found = self.found.entry(asset).or_insert(new);
        found.difference_px2 += difference_px2;
        found.foveation = found.foveation.max(bounds.foveation);
        #[expect(clippy::cast_precision_loss, reason = "a priority needs no more of a length than 24 bits")]
        Sum { difference_px2, bytes: if is_new { bytes as f32 } else { 0.0 } }
    }
}

impl Sum {
    fn with(self, other: Self) -> Self {
        Self { difference_px2: self.difference_px2 + other.difference_px2, bytes: self.bytes + other.bytes }
    }
}
