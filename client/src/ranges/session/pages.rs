//! Scene pages, and what comes ahead with them.

use lodestream_protocol::client::ClientEvent;
use lodestream_scene::blob::BlobId;
use lodestream_scene::view::Frustum;
use lodestream_select::Priority;
use lodestream_select::priority::{DIRECTORY, refine_priority};

use super::RangeSession;
use crate::ranges::directory::Item;

/// Scene pages that are requested ahead.
const PAGES_AHEAD: u32 = 64;
/// Priority of scene pages and base meshes in view.
const FIRST_FRAME: Priority = Priority::MAX;

impl RangeSession {
    /// Requests the next scene pages.
    pub(super) fn need_pages(&mut self) {
        let Some(opening) = self.directory.opening() else { return };
        if self.pages_in_view_known && self.next_page as usize == opening.pages.len() {
            return;
        }
        let frustum = self.view.map(|view| (view.frustum(), view.eye));
        let hidden = refine_priority(1.0, 1.0, 1.0);
        // Proxies are drawn before the instances for which they stand are known.
        let has_proxies = self.directory.page(0).is_some_and(|record| !record.page.proxies.is_empty());
        let in_view = if has_proxies { DIRECTORY } else { FIRST_FRAME };
        let eye = opening.header.camera.eye;
        let priorities: Vec<(u32, Priority)> = (self.next_page..)
            .zip(opening.pages.iter().skip(self.next_page as usize).take(PAGES_AHEAD as usize))
            .map(|(number, place)| {
                let seen = frustum
                    .as_ref()
                    .is_none_or(|(frustum, from)| sees(frustum, from, &eye, place.center, place.radius));
                // The first page has what is nearest and largest.
                let first = if number == 0 { FIRST_FRAME } else { in_view };
                (number, if seen || number == 0 { first } else { hidden })
            })
            .collect();
        let unseen_from = self.pages_seen_to();
        let known = self.next_page >= unseen_from;
        for (number, priority) in priorities {
            // A page is of no use before those that precede it.
            let priority = if number < unseen_from { priority.max(in_view) } else { priority };
            if self.directory.page(number).is_none() {
                self.items.need(Item::Page(number), priority);
            }
        }
        if known && !self.pages_in_view_known && self.view.is_some() {
            self.pages_in_view_known = true;
            self.events.push_back(ClientEvent::BasesSent);
        }
    }

    /// Number of the page behind the last one in view.
    pub(super) fn pages_seen_to(&self) -> u32 {
        let (Some(opening), Some(view)) = (self.directory.opening(), &self.view) else { return 0 };
        let frustum = view.frustum();
        let eye = opening.header.camera.eye;
        let seen = |place: &lodestream_scene::published::PagePlace| {
            sees(&frustum, &view.eye, &eye, place.center, place.radius)
        };
        opening
            .pages
            .iter()
            .rposition(seen)
            .map_or(0, |at| u32::try_from(at).unwrap_or(u32::MAX).saturating_add(1))
    }

    /// Announces scene pages in order, with the base meshes that come ahead.
    pub(super) fn number_pages(&mut self) {
        let ahead = self.flight_end();
        while let Some(record) = self.directory.next_in_order(self.next_page) {
            let page = record.page.clone();
            let assets = page.first_asset
                ..page.first_asset.saturating_add(u32::try_from(page.assets.len()).unwrap_or(0));
            self.events.push_back(ClientEvent::ScenePage(page));
            for asset in assets {
                self.need_ahead(Item::Blob(BlobId::base(asset)), FIRST_FRAME - 1, ahead);
            }
            self.need_ahead(Item::Source(self.next_page), DIRECTORY, ahead);
            self.next_page += 1;
        }
        self.need_pages();
    }

    /// Takes what lies behind a list of packs, as far as it comes ahead.
    pub(super) fn need_behind(&mut self, number: u32) {
        let ahead = self.flight_end();
        for item in self.directory.behind_source(number) {
            self.need_ahead(item, DIRECTORY, ahead);
        }
    }
}

/// Whether a page's sphere, relative to the start camera's eye, reaches into the view.
#[expect(clippy::cast_possible_truncation, reason = "relative to the eye, as spheres of instances are")]
fn sees(frustum: &Frustum, from: &[f64; 3], eye: &[f64; 3], center: [f32; 3], radius: f32) -> bool {
    let relative = [0, 1, 2].map(|axis| (f64::from(center[axis]) + eye[axis] - from[axis]) as f32);
    frustum.sees(relative.into(), radius)
}
