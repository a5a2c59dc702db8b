//! Proxies (hierarchical levels of detail, Erikson et al. 2001): meshes that stand for many instances while these are
//! small on the screen.
//!
//! Proxies form a forest over the instances, which are numbered so that each proxy stands for a run of them. A client
//! draws a proxy instead of its instances until its error is too large on the screen, then its children. An instance is a
//! part of the proxy, so that it can be drawn without those that are drawn themselves already.

use crate::encoding::encode_fields;

/// Most levels of a forest of proxies.
pub const MAX_PROXY_DEPTH: usize = 16;

/// Viewport of the start camera for which roots are made, in pixels.
pub const START_VIEWPORT_PX: [u32; 2] = [1280, 720];
/// How many times larger the error of a root is where the start camera does not see it.
pub const UNSEEN: f64 = 64.0;

/// One proxy. Its asset is placed without translation, rotation and scale: it is in world units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Proxy {
    /// Number of the asset.
    pub asset: u32,
    /// One more than the number of the proxy that stands for this one too, an earlier one; 0 for none.
    pub parent: u32,
    /// First instance that it stands for.
    pub first_instance: u32,
    /// Number of instances that it stands for; at least one.
    pub instance_count: u32,
    /// Number of proxies whose parent it is.
    pub child_count: u32,
    /// Bound on the distance between the finest mesh of the proxy and the surfaces that it stands for, in world units.
    pub error: f32,
}

encode_fields!(Proxy { asset, parent, first_instance, instance_count, child_count, error });

impl Proxy {
    /// Number of its parent.
    #[must_use]
    pub const fn parent(&self) -> Option<u32> {
        self.parent.checked_sub(1)
    }

    /// Whether it stands for something, and its error is a finite number of at least 0.
    pub(crate) const fn is_valid(&self) -> bool {
        self.error.is_finite() && self.error >= 0.0 && self.instance_count > 0
    }

    /// The instances that it stands for.
    #[must_use]
    pub const fn instances(&self) -> std::ops::Range<u32> {
        self.first_instance..self.first_instance.saturating_add(self.instance_count)
    }
}

/// What of a scene's instances and proxies is drawn.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cut {
    /// Numbers of the proxies that are drawn, ascending.
    pub proxies: Vec<u32>,
    /// Number of instances that it is about; later ones are not drawn.
    pub instances: u32,
    /// Those of them that are not drawn, since a proxy stands for them: ascending runs as first and end.
    pub covered: Vec<[u32; 2]>,
    /// Drawn proxies that do not stand for all of their instances, by ascending number.
    pub partial: Vec<PartialProxy>,
}

/// A proxy that is drawn without some of its parts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PartialProxy {
    /// Its number.
    pub proxy: u32,
    /// Parts that are not drawn: ascending runs as first and end. A part is an instance, numbered from the proxy's first.
    pub hidden: Vec<[u32; 2]>,
}

encode_fields!(PartialProxy { proxy, hidden });

impl PartialProxy {
    /// Whether it is drawn without a part.
    #[must_use]
    pub fn hides(&self, part: u32) -> bool {
        is_within(&self.hidden, part)
    }
}

fn is_within(runs: &[[u32; 2]], number: u32) -> bool {
    let begun = runs.partition_point(|[first, _]| *first <= number);
    begun.checked_sub(1).is_some_and(|run| number < runs[run][1])
}

impl Cut {
    /// Whether an instance is drawn.
    #[must_use]
    pub fn draws(&self, instance: u32) -> bool {
        instance < self.instances && !is_within(&self.covered, instance)
    }

    /// Whether a drawn proxy is drawn without a part.
    #[must_use]
    pub fn hides(&self, proxy: u32, part: u32) -> bool {
        let at = self.partial.binary_search_by_key(&proxy, |partial| partial.proxy);
        at.is_ok_and(|at| self.partial[at].hides(part))
    }
}

encode_fields!(Cut { proxies, instances, covered, partial });

/// A proxy that does not fit those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ProxyError {
    /// Not in the order of numbers.
    #[error("proxies do not follow those of the page before")]
    Gap,
    /// The parent comes later or does not exist.
    #[error("proxy {0} has a parent that is no earlier proxy")]
    Parent(u32),
    /// Instances beyond the scene's or the parent's, none, or those of another proxy of the same parent.
    #[error("proxy {0} stands for instances that its parent does not have for it")]
    Instances(u32),
    /// More than its parent announces.
    #[error("proxy {0} is more than its parent announces")]
    Unannounced(u32),
    /// The forest is too deep.
    #[error("proxy {0} lies deeper than {MAX_PROXY_DEPTH} levels")]
    TooDeep(u32),
    /// The placed asset is of a later page.
    #[error("proxy {0} refers to an asset of a later page")]
    AssetOfLaterPage(u32),
}

/// A node of [`Proxies`].
#[derive(Clone, Debug)]
pub struct ProxyNode {
    /// The proxy.
    pub proxy: Proxy,
    /// Numbers of its children so far, by ascending instances.
    pub children: Vec<u32>,
    /// Levels above it.
    pub depth: usize,
}

/// The forest of a scene's proxies, as far as its pages have arrived.
#[derive(Clone, Debug, Default)]
pub struct Proxies {
    nodes: Vec<ProxyNode>,
    roots: Vec<u32>,
}

impl Proxies {
    /// The proxies by number.
    #[must_use]
    pub fn nodes(&self) -> &[ProxyNode] {
        &self.nodes
    }

    /// Numbers of the proxies without a parent, by ascending instances.
    #[must_use]
    pub fn roots(&self) -> &[u32] {
        &self.roots
    }

    /// The instances of a proxy for which none of its children stands, as runs.
    ///
    /// # Panics
    /// If there is no such proxy.
    #[must_use]
    pub fn own_instances(&self, number: u32) -> Vec<std::ops::Range<u32>> {
        let node = &self.nodes[number as usize];
        let mut runs = Vec::with_capacity(node.children.len() + 1);
        let mut from = node.proxy.first_instance;
        for &child in &node.children {
            let of = self.nodes[child as usize].proxy.instances();
            runs.push(from..of.start);
            from = of.end;
        }
        runs.push(from..node.proxy.instances().end);
        runs.retain(|run| !run.is_empty());
        runs
    }

    /// Number of proxies.
    #[must_use]
    pub fn len(&self) -> u32 {
        u32::try_from(self.nodes.len()).unwrap_or(u32::MAX)
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Adds the proxies of a page to a scene with `instances` instances, of which `assets` assets are known.
    ///
    /// # Errors
    /// The first proxy that does not fit; those before it stay.
    pub fn add(&mut self, first: u32, list: &[Proxy], assets: u32, instances: u32) -> Result<(), ProxyError> {
        if first != self.len() {
            return Err(ProxyError::Gap);
        }
        for (number, proxy) in (first..).zip(list) {
            self.add_one(number, proxy, assets, instances)?;
        }
        Ok(())
    }

    fn add_one(&mut self, number: u32, proxy: &Proxy, assets: u32, instances: u32) -> Result<(), ProxyError> {
        if proxy.asset >= assets {
            return Err(ProxyError::AssetOfLaterPage(number));
        }
        let (bounds, depth, siblings) = match proxy.parent() {
            None => (0..instances, 0, &self.roots),
            Some(parent) => {
                let parent = self.nodes.get(parent as usize).ok_or(ProxyError::Parent(number))?;
                if parent.children.len() >= parent.proxy.child_count as usize {
                    return Err(ProxyError::Unannounced(number));
                }
                (parent.proxy.instances(), parent.depth + 1, &parent.children)
            }
        };
        if depth >= MAX_PROXY_DEPTH {
            return Err(ProxyError::TooDeep(number));
        }
        let last =
            siblings.last().map_or(bounds.start, |&last| self.nodes[last as usize].proxy.instances().end);
        let of = proxy.instances();
        if proxy.instance_count == 0 || of.start < last || of.end > bounds.end {
            return Err(ProxyError::Instances(number));
        }
        match proxy.parent() {
            None => self.roots.push(number),
            Some(parent) => self.nodes[parent as usize].children.push(number),
        }
        self.nodes.push(ProxyNode { proxy: *proxy, children: Vec::new(), depth });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn proxy(parent: u32, first_instance: u32, instance_count: u32, child_count: u32) -> Proxy {
        Proxy { asset: 0, parent, first_instance, instance_count, child_count, error: 1.0 }
    }

    #[test]
    fn a_forest_is_taken_page_by_page() {
        let mut proxies = Proxies::default();
        proxies.add(0, &[proxy(0, 0, 10, 2), proxy(0, 10, 2, 0)], 1, 12).unwrap();
        proxies.add(2, &[proxy(1, 0, 4, 0), proxy(1, 5, 5, 0)], 1, 12).unwrap();
        assert_eq!((proxies.roots(), &proxies.nodes()[0].children[..]), (&[0, 1][..], &[2, 3][..]));
        assert_eq!(proxies.nodes()[3].depth, 1);
        let own =
            [0, 1].map(|number| proxies.own_instances(number).into_iter().flatten().collect::<Vec<_>>());
        assert_eq!(own, [vec![4], vec![10, 11]]);
    }

    #[test]
    fn a_cut_draws_what_it_knows_and_does_not_cover() {
        let partial = vec![PartialProxy { proxy: 0, hidden: vec![[0, 1], [3, 5]] }];
        let cut = Cut { proxies: vec![0], instances: 9, covered: vec![[1, 3], [5, 8]], partial };
        let drawn: Vec<u32> = (0..12).filter(|&instance| cut.draws(instance)).collect();
        assert_eq!(drawn, [0, 3, 4, 8]);
        let hidden: Vec<u32> = (0..9).filter(|&part| cut.hides(0, part)).collect();
        assert_eq!((hidden, cut.hides(1, 0)), (vec![0, 3, 4], false));
    }

    #[test]
    fn proxies_that_do_not_fit_are_errors() {
        let add = |list: &[Proxy]| Proxies::default().add(0, list, 1, 12);
        let root = proxy(0, 0, 10, 1);
        assert_eq!(add(&[root, proxy(3, 0, 4, 0)]), Err(ProxyError::Parent(1)));
        assert_eq!(add(&[root, proxy(1, 8, 4, 0)]), Err(ProxyError::Instances(1)));
        assert_eq!(
            add(&[root, proxy(0, 9, 3, 0)]),
            Err(ProxyError::Instances(1)),
            "two roots of one instance"
        );
        assert_eq!(add(&[proxy(0, 0, 13, 0)]), Err(ProxyError::Instances(0)));
        assert_eq!(add(&[proxy(0, 0, 0, 0)]), Err(ProxyError::Instances(0)));
        assert_eq!(add(&[proxy(0, u32::MAX, u32::MAX, 0)]), Err(ProxyError::Instances(0)));
        assert_eq!(add(&[root, proxy(1, 0, 4, 0), proxy(1, 4, 4, 0)]), Err(ProxyError::Unannounced(2)));
        assert_eq!(add(&[Proxy { asset: 1, ..root }]), Err(ProxyError::AssetOfLaterPage(0)));
        assert_eq!(Proxies::default().add(1, &[root], 1, 12), Err(ProxyError::Gap));
        let deep: Vec<_> = (0..17).map(|parent| proxy(parent, 0, 10, 1)).collect();
        assert_eq!(add(&deep), Err(ProxyError::TooDeep(16)));
    }
}
