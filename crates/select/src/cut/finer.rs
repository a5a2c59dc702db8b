//! What makes a cut finer: base meshes that replace a part of a proxy whose error is too large.
//!
//! Each replaces the proxy for what it stands for alone, so each has a priority of its own: the difference that the
//! proxy's error makes there, per byte. Wanted are the base meshes of the final cut; of a proxy between only if it is the
//! better bargain, so a near view does not fetch every level.

use std::collections::BTreeMap;
use std::ops::Range;

use glam::DVec3;
use lodestream_scene::description::{AssetEntry, Instance};
use lodestream_scene::proxy::Proxies;

use crate::difference::Picture;
use crate::priority::{Priority, refine_priority};
use crate::project::{Bounds, Projection};
use crate::root_error::middle;

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
    /// Whether the mesh of a proxy is there and drawn where nothing finer is.
    fn is_drawn(&self, proxy: u32) -> bool;
    /// Whether a proxy in view that errs by so many pixels must be replaced.
    fn must_open(&self, proxy: u32, error_px: f32) -> bool;
    /// Error of a drawn proxy in a sphere, where it is smaller there than that of the whole proxy.
    fn error_within(&self, proxy: u32, center: [f64; 3], radius: f32) -> Option<f32>;
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
/// to the final cut, and a difference for each of these and each proxy above it.
pub fn finer(
    forest: &impl Forest,
    projection: &Projection,
    picture: &Picture,
    drawn: impl IntoIterator<Item = u32>,
) -> Vec<Finer> {
    let mut found = Found::default();
    for number in drawn {
        let proxy = forest.proxies().nodes()[number as usize].proxy;
        if let Some(entry) = forest.entry(proxy.asset) {
            let error = proxy.error + entry.root_error;
            let below = Below::default();
            let mut search = Search { forest, projection, drawn: (number, error), below, found: &mut found };
            search.look_below(number);
            search.below.choose(picture, &mut found);
        }
    }
    found.finer.into_values().collect()
}

/// Base meshes, each once.
#[derive(Default)]
struct Found {
    finer: BTreeMap<u32, Finer>,
    /// By asset: whether a piece has its bytes.
    counted: Vec<bool>,
}

impl Found {
    /// Whether an asset's bytes are counted already; they are from now on.
    fn count(&mut self, asset: u32) -> bool {
        let asset = asset as usize;
        self.counted.resize(self.counted.len().max(asset + 1), false);
        std::mem::replace(&mut self.counted[asset], true)
    }

    /// Adds a use of a base mesh.
    fn add(&mut self, new: Finer) {
        let found = self.finer.entry(new.asset).or_insert(Finer { difference_px2: 0.0, ..new });
        found.difference_px2 += new.difference_px2;
        found.foveation = found.foveation.max(new.foveation);
    }
}

/// What is below a drawn proxy in view.
#[derive(Default)]
struct Below {
    /// What the final cut consists of.
    pieces: Vec<Piece>,
    /// Proxies between, each before those below it.
    between: Vec<Between>,
}

/// A base mesh of the final cut.
struct Piece {
    asset: u32,
    placed: Placed,
    bounds: Bounds,
    /// Error of what is drawn there, in world units.
    drawn_error: f32,
    /// Error of the base mesh, in world units.
    error: f32,
    bytes: u32,
    /// Whether an earlier piece has the same base mesh.
    is_shared: bool,
}

/// A proxy that is opened in the final cut.
struct Between {
    proxy: u32,
    asset: u32,
    error: f32,
    bytes: u32,
    foveation: f32,
    /// The pieces that it stands for.
    pieces: Range<usize>,
}

impl Piece {
    /// Difference of a surface with an error in world units that stands for it.
    fn difference_px2(&self, picture: &Picture, error: f32) -> f32 {
        picture.object_px2(error * self.bounds.px_per_unit, self.bounds.coverage_px)
    }

    /// How much less the difference is with its base mesh than with an error, or with as many of its chunks as make most
    /// of their bytes, per length of the base mesh: the error falls as the bytes grow.
    fn gain_px2(&self, picture: &Picture, error: f32) -> f32 {
        let before = self.difference_px2(picture, error);
        let base = picture.error_px2(self.error * self.bounds.px_per_unit, self.bounds.coverage_px);
        if 2.0 * base > before { before * before / (4.0 * base) } else { before - base }
    }
}

impl Below {
    /// Lists the pieces, and each proxy between that makes more difference per byte than the pieces for which it stands:
    /// these count from its error then.
    fn choose(&self, picture: &Picture, found: &mut Found) {
        let mut errors: Vec<f32> = self.pieces.iter().map(|piece| piece.drawn_error).collect();
        for of in &self.between {
            let (pieces, errors) = (&self.pieces[of.pieces.clone()], &mut errors[of.pieces.clone()]);
            let (mut own, mut below, mut bytes) = (0.0, 0.0, 0.0);
            for (piece, error) in pieces.iter().zip(&*errors) {
                own += piece.difference_px2(picture, *error)
                    - piece.difference_px2(picture, of.error.min(*error));
                below += piece.gain_px2(picture, *error);
                bytes += if piece.is_shared { 0.0 } else { as_f32(piece.bytes) };
            }
            if own * bytes > below * as_f32(of.bytes) {
                errors.iter_mut().for_each(|error| *error = error.min(of.error));
                found.add(Finer {
                    asset: of.asset,
                    first: Placed::Proxy(of.proxy),
                    difference_px2: own,
                    bytes: of.bytes,
                    foveation: of.foveation,
                });
            }
        }
        for (piece, error) in self.pieces.iter().zip(errors) {
            found.add(Finer {
                asset: piece.asset,
                first: piece.placed,
                difference_px2: piece.gain_px2(picture, error),
                bytes: piece.bytes,
                foveation: piece.bounds.foveation,
            });
        }
    }
}

struct Search<'a, F> {
    forest: &'a F,
    projection: &'a Projection,
    /// The drawn proxy, and its error.
    drawn: (u32, f32),
    below: Below,
    found: &'a mut Found,
}

impl<'a, F: Forest> Search<'a, F> {
    /// Adds what is below a proxy.
    fn look_below(&mut self, number: u32) {
        let forest: &'a F = self.forest;
        let proxies = forest.proxies();
        for &child in &proxies.nodes()[number as usize].children {
            let proxy = &proxies.nodes()[child as usize].proxy;
            let Some(entry) = forest.entry(proxy.asset) else { continue };
            let bounds = self.projection.bounds_within(entry, proxy.error);
            // What is below one that is there makes that one finer.
            if !bounds.visible || forest.is_drawn(child) {
                continue;
            }
            #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
            let error_px = self.projection.error_px(f64::from(proxy.error), bounds.depth) as f32;
            let error = proxy.error + entry.root_error;
            if !forest.must_open(child, error_px) {
                let center = middle(entry.origin, entry.sphere.center);
                self.add(proxy.asset, Placed::Proxy(child), error, bounds, (center, entry.sphere.radius));
                continue;
            }
            let at = self.below.between.len();
            let first = self.below.pieces.len();
            if forest.is_missing(proxy.asset) {
                self.below.between.push(Between {
                    proxy: child,
                    asset: proxy.asset,
                    error,
                    bytes: entry.base_bytes,
                    foveation: bounds.foveation,
                    pieces: first..first,
                });
            }
            self.look_below(child);
            if let Some(of) = self.below.between.get_mut(at).filter(|of| of.proxy == child) {
                of.pieces.end = self.below.pieces.len();
            }
        }
        for instance in proxies.own_instances(number).into_iter().flatten() {
            let Some(of) = forest.instance(instance) else { continue };
            let Some(entry) = forest.entry(of.asset) else { continue };
            let bounds = self.projection.bounds(entry, of);
            if bounds.visible {
                let scale = of.placement.scale;
                let sphere = (of.to_world(entry.origin, entry.sphere.center), entry.sphere.radius * scale);
                self.add(of.asset, Placed::Instance(instance), entry.root_error * scale, bounds, sphere);
            }
        }
    }

    /// Adds a use of a base mesh that is missing.
    fn add(
        &mut self,
        asset: u32,
        placed: Placed,
        error: f32,
        bounds: Bounds,
        (center, radius): (DVec3, f32),
    ) {
        if let Some(entry) = self.forest.entry(asset).filter(|_| self.forest.is_missing(asset)) {
            let is_shared = self.found.count(asset);
            let bytes = entry.base_bytes;
            let (drawn, of_all) = self.drawn;
            let within = self.forest.error_within(drawn, center.to_array(), radius);
            let drawn_error = within.map_or(of_all, |error| error.min(of_all));
            self.below.pieces.push(Piece { asset, placed, bounds, drawn_error, error, bytes, is_shared });
        }
    }
}

#[expect(clippy::cast_precision_loss, reason = "a priority needs no more of a length than 24 bits")]
const fn as_f32(bytes: u32) -> f32 {
    bytes as f32
}

#[cfg(test)]
mod tests {
    use lodestream_scene::proxy::Proxy;

    use super::*;
    use crate::testing::plane_entry;

    /// A root, a proxy below it, and two instances: all in view of a camera 20 units away.
    struct Scene {
        proxies: Proxies,
        instances: Vec<Instance>,
        /// Of the root, the proxy between and the instances.
        entries: Vec<AssetEntry>,
        /// Error of the root around the instances.
        within: Option<f32>,
    }

    impl Scene {
        /// `errors` are those of the two proxies, `bytes` the lengths of the base mesh of the lower one and of the instances.
        fn new(errors: [f32; 2], bytes: [u32; 2]) -> Self {
            let mut proxies = Proxies::default();
            let root =
                Proxy { asset: 0, instance_count: 2, child_count: 1, error: errors[0], ..Proxy::default() };
            let between = Proxy { asset: 1, parent: 1, error: errors[1], child_count: 0, ..root };
            proxies.add(0, &[root, between], 4, 2).unwrap();
            let entry = |bytes| AssetEntry { root_error: 0.0, ..plane_entry("", &[], bytes) };
            Self {
                proxies,
                instances: vec![Instance::at(2, [0.0; 3]), Instance::at(3, [1.0, 0.0, 0.0])],
                entries: vec![entry(100), entry(bytes[0]), entry(bytes[1]), entry(bytes[1])],
                within: None,
            }
        }

        /// Assets and differences of what makes the root finer.
        fn finer(&self) -> Vec<(u32, f32)> {
            let camera = lodestream_scene::description::Camera {
                eye: [0.0, 0.0, 20.0],
                target: [0.0; 3],
                up: [0.0, 1.0, 0.0],
                fov_y: 1.0,
            };
            let view = camera.view([1280, 720], 1.0);
            let list = finer(self, &Projection::new(&view), &Picture::new(&view), [0]);
            list.iter().map(|finer| (finer.asset, finer.difference_px2())).collect()
        }
    }

    impl Forest for Scene {
        fn proxies(&self) -> &Proxies {
            &self.proxies
        }

        fn instance(&self, number: u32) -> Option<&Instance> {
            self.instances.get(number as usize)
        }

        fn entry(&self, asset: u32) -> Option<&AssetEntry> {
            self.entries.get(asset as usize)
        }

        fn is_missing(&self, asset: u32) -> bool {
            asset > 0
        }

        fn is_drawn(&self, proxy: u32) -> bool {
            proxy == 0
        }

        fn error_within(&self, _: u32, _: [f64; 3], _: f32) -> Option<f32> {
            self.within
        }

        fn must_open(&self, _: u32, _: f32) -> bool {
            true
        }
    }

    #[test]
    fn a_proxy_between_is_wanted_if_it_helps_what_it_stands_for() {
        let assets = |errors, bytes| {
            Scene::new(errors, bytes).finer().iter().map(|(asset, _)| *asset).collect::<Vec<_>>()
        };
        assert_eq!(assets([8.0, 0.1], [100, 5000]), [1, 2, 3], "fine and short");
        assert_eq!(assets([8.0, 0.1], [100, 60]), [2, 3], "more bytes than what it stands for");
        // As large as the instances: nothing of them looks right with it, although it is much finer than the root.
        assert_eq!(assets([8.0, 1.5], [100, 5000]), [2, 3]);
    }

    #[test]
    fn where_a_root_errs_little_it_counts_little_and_no_proxy_between_is_wanted() {
        let with = |within| Scene { within, ..Scene::new([8.0, 0.1], [100, 5000]) }.finer();
        let (everywhere, little) = (with(None), with(Some(0.05)));
        assert_eq!(little.iter().map(|(asset, _)| *asset).collect::<Vec<_>>(), [2, 3]);
        let sum = |list: &[(u32, f32)]| list.iter().map(|(_, difference)| difference).sum::<f32>();
        assert!(sum(&little) < 0.2 * sum(&everywhere), "{little:?} {everywhere:?}");
    }

    #[test]
    fn what_a_proxy_between_has_shown_counts_once() {
        let all: f32 =
            Scene::new([8.0, 0.1], [100, 60]).finer().iter().map(|(_, difference)| difference).sum();
        let parts = Scene::new([8.0, 0.1], [100, 5000]).finer();
        assert!(parts[0].1 > parts[1].1 + parts[2].1, "most by the proxy: {parts:?}");
        let sum: f32 = parts.iter().map(|(_, difference)| difference).sum();
        assert!((sum - all).abs() < 1e-3 * all, "{sum} {all}");
    }
}
