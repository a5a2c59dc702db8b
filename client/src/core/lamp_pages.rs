//! Lamps of the scene: which pages of them are here, and which a view wants.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use lodestream_protocol::blob::{BlobId, LampBlob};
use lodestream_protocol::lamps::{
    First, LISTED_PER_PAGE, Lamp, Lamps, LampsError, ListedLamps, decode_directory, decode_page,
};
use lodestream_protocol::scene::SceneHeader;
use lodestream_protocol::select::{Projection, State, Wanted, lamp_priority};
use lodestream_protocol::view::View;

/// Pages of the directory count as if they lit the whole picture, and bring what follows them.
const BEHIND_DIRECTORY_BYTES: u32 = 12_000;

/// Lamps of the scene that came together.
pub(super) type Page = Arc<[Lamp]>;

/// A blob of lamps that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum LampBlobError {
    /// Only a part of it came.
    #[error("only a part of it came")]
    Partial,
    /// Not what the scene says.
    #[error(transparent)]
    Lamps(#[from] LampsError),
    /// Of something that does not exist.
    #[error("there is no such page")]
    Unknown,
}

/// A page of lamps.
#[derive(Clone, Debug, Default)]
struct Slot {
    /// What it lights, once the directory says so.
    listed: Option<ListedLamps>,
    state: State,
    lamps: Option<Page>,
}

/// See the module.
#[derive(Debug)]
pub(super) struct LampPages {
    count: u32,
    directory: Vec<State>,
    /// As many as there are lamps for: the count has been checked against what can be.
    pages: Vec<Slot>,
}

impl LampPages {
    /// What a scene says of its lamps; with them those that came at once.
    ///
    /// # Errors
    /// Lamps that cannot be.
    pub(super) fn new(lamps: &Lamps) -> Result<(Self, Option<Page>), LampsError> {
        let count = lamps.count;
        let first = lamps.first()?;
        let mut this = Self {
            count,
            directory: vec![State::Absent; Lamps::directory_pages_of(count) as usize],
            pages: vec![Slot::default(); Lamps::pages_of(count) as usize],
        };
        let came = match first {
            First::Lamps(lamps) => {
                this.directory.fill(State::Applied);
                let page: Page = lamps.into();
                if let Some(slot) = this.pages.first_mut() {
                    *slot = Slot { listed: None, state: State::Applied, lamps: Some(Arc::clone(&page)) };
                }
                Some(page)
            }
            First::Directory(listed) => {
                this.list(0, listed);
                None
            }
            First::Nothing => None,
        };
        Ok((this, came))
    }

    /// Lamps in all, here or not.
    pub(super) const fn count(&self) -> u32 {
        self.count
    }

    /// The lamps that are here, by page.
    pub(super) fn here(&self) -> impl Iterator<Item = &Lamp> {
        self.pages.iter().filter_map(|slot| slot.lamps.as_deref()).flatten()
    }

    pub(super) fn state(&self, blob: LampBlob) -> State {
        match blob {
            LampBlob::DirectoryPage(page) => self.directory.get(page as usize).copied().unwrap_or_default(),
            LampBlob::Page(page) => self.pages.get(page as usize).map_or(State::Absent, |slot| slot.state),
        }
    }

    pub(super) fn set_state(&mut self, blob: LampBlob, state: State) {
        let held = match blob {
            LampBlob::DirectoryPage(page) => self.directory.get_mut(page as usize),
            LampBlob::Page(page) => self.pages.get_mut(page as usize).map(|slot| &mut slot.state),
        };
        if let Some(held) = held {
            *held = state;
        }
    }

    /// Adds what `view` wants to `wanted`, whose order is by priority: pages of the directory, and pages whose light is
    /// seen, by how much of the picture it is; and to `failed` what of it will not come. Says whether nothing of it may
    /// still come.
    pub(super) fn want(
        &self,
        view: &View,
        header: &SceneHeader,
        wanted: &mut Vec<Wanted>,
        failed: &mut Vec<BlobId>,
    ) -> bool {
        let before = wanted.len();
        let mut want = |id, priority, bytes, state| match state {
            State::Failed => failed.push(id),
            State::Absent | State::InFlight => wanted.push(Wanted::whole(id, priority, bytes, state)),
            State::Cached | State::Applied => {}
        };
        let whole = lamp_priority(view, 1.0, f32::MAX, BEHIND_DIRECTORY_BYTES);
        for (page, &state) in (0..).zip(&self.directory) {
            want(BlobId::lamp_directory(page), whole, None, state);
        }
        let (projection, frustum) = (Projection::new(view), view.frustum());
        let other = brightness(header);
        for (number, slot) in (0..).zip(&self.pages) {
            let Some(listed) = slot.listed.filter(|_| slot.state != State::Applied) else { continue };
            let center = (Vec3::from(listed.center).as_dvec3() - DVec3::from(view.eye)).as_vec3();
            if !frustum.sees(center, listed.radius) {
                continue;
            }
            // Within the sphere all of the picture is lit.
            let (distance, radius) = (f64::from(center.length()), f64::from(listed.radius));
            let radius_px =
                if distance <= radius { f32::MAX } else { projection.error_px(radius, distance) as f32 };
            if radius_px <= view.target_px {
                continue;
            }
            let priority = lamp_priority(view, share(&listed, other), radius_px, listed.bytes);
            want(BlobId::lamp_page(number), priority, Some(listed.bytes), slot.state);
        }
        let wants = wanted.len() > before;
        if wants {
            // Stable: what was ordered stays in its order.
            wanted.sort_by_key(|wanted| std::cmp::Reverse(wanted.priority));
        }
        !wants
    }

    /// Uses a blob that came whole; gives the lamps that are new by it.
    pub(super) fn take(
        &mut self,
        blob: LampBlob,
        bytes: &[u8],
    ) -> Result<Option<(u32, Page)>, LampBlobError> {
        let came = match blob {
            LampBlob::DirectoryPage(page) => {
                let count = Lamps::on_directory_page(self.count, page);
                if count == 0 {
                    return Err(LampBlobError::Unknown);
                }
                self.list(page, decode_directory(bytes, count)?);
                None
            }
            LampBlob::Page(number) => {
                let count = Lamps::on_page(self.count, number);
                let slot = self.pages.get_mut(number as usize).ok_or(LampBlobError::Unknown)?;
                let page: Page = decode_page(bytes, count)?.into();
                slot.lamps = Some(Arc::clone(&page));
                Some((number, page))
            }
        };
        self.set_state(blob, State::Applied);
        Ok(came)
    }

    /// Notes what the pages of one of the directory light.
    fn list(&mut self, page: u32, listed: Vec<ListedLamps>) {
        let first = page as usize * LISTED_PER_PAGE as usize;
        for (slot, listed) in self.pages.iter_mut().skip(first).zip(listed) {
            slot.listed = Some(listed);
        }
        self.set_state(LampBlob::DirectoryPage(page), State::Applied);
    }
}

/// Light of sun and sky on a surface that faces it, over π.
fn brightness(header: &SceneHeader) -> f32 {
    let largest = |color: [f32; 3]| color.into_iter().fold(0.0, f32::max);
    largest(header.light.color) + largest(header.light.ambient)
}

/// Share of a page's lamps in all light where they shine, taken a quarter of their reach away.
fn share(listed: &ListedLamps, other: f32) -> f32 {
    let distance = (0.25 * listed.radius).max(f32::MIN_POSITIVE);
    let lamps = listed.intensity / (std::f32::consts::PI * distance * distance);
    let share = lamps / (lamps + other);
    // Of what is infinitely bright, all.
    if share.is_finite() { share } else { 1.0 }
}
