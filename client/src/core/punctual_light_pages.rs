//! Pages of the scene's punctual lights: which have arrived, and which a view needs.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use lodestream_scene::blob::{BlobId, PunctualLightBlob};
use lodestream_scene::description::SceneHeader;
use lodestream_scene::punctual_lights::{
    First, LISTED_PER_PAGE, PunctualLight, PunctualLightPageEntry, PunctualLights, PunctualLightsError,
    decode_directory, decode_page,
};
use lodestream_scene::view::View;
use lodestream_select::{Projection, State, Wanted, punctual_light_priority};

/// Bytes that a page of the directory stands for in its priority: its own and those of the pages that it lists. It
/// counts as if it lit the whole picture.
const DIRECTORY_PRIORITY_BYTES: u32 = 12_000;

/// The punctual lights of one page.
pub(super) type Page = Arc<[PunctualLight]>;

/// Why a blob of punctual lights cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum PunctualLightBlobError {
    /// Only a part of it has arrived.
    #[error("only a part of it has arrived")]
    Partial,
    /// It is invalid or does not fit the scene.
    #[error(transparent)]
    PunctualLights(#[from] PunctualLightsError),
    /// The scene has no such page.
    #[error("there is no such page")]
    Unknown,
}

/// State and contents of a page of punctual lights.
#[derive(Clone, Debug, Default)]
struct Slot {
    /// Its entry in the directory, once known.
    listed: Option<PunctualLightPageEntry>,
    state: State,
    punctual_lights: Option<Page>,
}

/// States of all pages of punctual lights, and of the directory that lists them.
#[derive(Debug)]
pub(super) struct PunctualLightPages {
    count: u32,
    directory: Vec<State>,
    /// Their number follows from the count of punctual lights, which has been checked.
    pages: Vec<Slot>,
}

impl PunctualLightPages {
    /// Starts from the scene's description of its punctual lights; returns the first page too if the description holds
    /// it.
    ///
    /// # Errors
    /// The description is invalid.
    pub(super) fn new(punctual_lights: &PunctualLights) -> Result<(Self, Option<Page>), PunctualLightsError> {
        let count = punctual_lights.count;
        let first = punctual_lights.first()?;
        let mut this = Self {
            count,
            directory: vec![State::Absent; PunctualLights::directory_pages_of(count) as usize],
            pages: vec![Slot::default(); PunctualLights::pages_of(count) as usize],
        };
        let first_page = match first {
            First::PunctualLights(punctual_lights) => {
                this.directory.fill(State::Applied);
                let page: Page = punctual_lights.into();
                if let Some(slot) = this.pages.first_mut() {
                    *slot = Slot {
                        listed: None,
                        state: State::Applied,
                        punctual_lights: Some(Arc::clone(&page)),
                    };
                }
                Some(page)
            }
            First::Directory(listed) => {
                this.list(0, listed);
                None
            }
            First::Nothing => None,
        };
        Ok((this, first_page))
    }

    /// Number of punctual lights in the scene.
    pub(super) const fn count(&self) -> u32 {
        self.count
    }

    /// The pages that have arrived, with their numbers.
    pub(super) fn pages(&self) -> impl Iterator<Item = (u32, Page)> {
        (0..).zip(&self.pages).filter_map(|(number, slot)| Some((number, slot.punctual_lights.clone()?)))
    }

    /// The punctual lights that have arrived, ordered by page.
    pub(super) fn received(&self) -> impl Iterator<Item = &PunctualLight> {
        self.pages.iter().filter_map(|slot| slot.punctual_lights.as_deref()).flatten()
    }

    pub(super) fn state(&self, blob: PunctualLightBlob) -> State {
        match blob {
            PunctualLightBlob::DirectoryPage(page) => {
                self.directory.get(page as usize).copied().unwrap_or_default()
            }
            PunctualLightBlob::Page(page) => {
                self.pages.get(page as usize).map_or(State::Absent, |slot| slot.state)
            }
        }
    }

    pub(super) fn set_state(&mut self, blob: PunctualLightBlob, state: State) {
        let held = match blob {
            PunctualLightBlob::DirectoryPage(page) => self.directory.get_mut(page as usize),
            PunctualLightBlob::Page(page) => self.pages.get_mut(page as usize).map(|slot| &mut slot.state),
        };
        if let Some(held) = held {
            *held = state;
        }
    }

    /// Adds the blobs that `view` needs to `wanted`, which is ordered by priority: pages of the directory, and pages
    /// whose light is in view, by their share of the picture's light. Adds those that failed to `failed`. Returns
    /// whether none is left to request.
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
        let whole = punctual_light_priority(view, 1.0, f32::MAX, DIRECTORY_PRIORITY_BYTES);
        for (page, &state) in (0..).zip(&self.directory) {
            want(BlobId::punctual_light_directory(page), whole, None, state);
        }
        let (projection, frustum) = (Projection::new(view), view.frustum());
        let other = brightness(header);
        for (number, slot) in (0..).zip(&self.pages) {
            let Some(listed) = slot.listed.filter(|_| slot.state != State::Applied) else { continue };
            let center = (Vec3::from(listed.center).as_dvec3() - DVec3::from(view.eye)).as_vec3();
            if !frustum.sees(center, listed.radius) {
                continue;
            }
            // From inside the sphere, the whole picture is lit.
            let (distance, radius) = (f64::from(center.length()), f64::from(listed.radius));
            let radius_px =
                if distance <= radius { f32::MAX } else { projection.error_px(radius, distance) as f32 };
            if radius_px <= view.target_px {
                continue;
            }
            let priority = punctual_light_priority(view, share(&listed, other), radius_px, listed.bytes);
            want(BlobId::punctual_light_page(number), priority, Some(listed.bytes), slot.state);
        }
        let wants = wanted.len() > before;
        if wants {
            // A stable sort keeps the selection's order.
            wanted.sort_by_key(|wanted| std::cmp::Reverse(wanted.priority));
        }
        !wants
    }

    /// Decodes a complete blob; returns the page's number and its punctual lights if it is a page.
    pub(super) fn take(
        &mut self,
        blob: PunctualLightBlob,
        bytes: &[u8],
    ) -> Result<Option<(u32, Page)>, PunctualLightBlobError> {
        let new_page = match blob {
            PunctualLightBlob::DirectoryPage(page) => {
                let count = PunctualLights::on_directory_page(self.count, page);
                if count == 0 {
                    return Err(PunctualLightBlobError::Unknown);
                }
                self.list(page, decode_directory(bytes, count)?);
                None
            }
            PunctualLightBlob::Page(number) => {
                let count = PunctualLights::on_page(self.count, number);
                let slot = self.pages.get_mut(number as usize).ok_or(PunctualLightBlobError::Unknown)?;
                let page: Page = decode_page(bytes, count)?.into();
                slot.punctual_lights = Some(Arc::clone(&page));
                Some((number, page))
            }
        };
        self.set_state(blob, State::Applied);
        Ok(new_page)
    }

    /// Adds the entries of a page of the directory.
    fn list(&mut self, page: u32, listed: Vec<PunctualLightPageEntry>) {
        let first = page as usize * LISTED_PER_PAGE as usize;
        for (slot, listed) in self.pages.iter_mut().skip(first).zip(listed) {
            slot.listed = Some(listed);
        }
        self.set_state(PunctualLightBlob::DirectoryPage(page), State::Applied);
    }
}

/// Radiance of a surface that faces sun and sky, over π.
fn brightness(header: &SceneHeader) -> f32 {
    let largest = |color: [f32; 3]| color.into_iter().fold(0.0, f32::max);
    largest(header.light.color) + largest(header.light.ambient)
}

/// Share of a page's punctual lights in the light of a surface at a quarter of their range.
fn share(listed: &PunctualLightPageEntry, other: f32) -> f32 {
    let distance = (0.25 * listed.radius).max(f32::MIN_POSITIVE);
    let punctual_lights = listed.intensity / (std::f32::consts::PI * distance * distance);
    let share = punctual_lights / (punctual_lights + other);
    // Infinitely bright lights have the whole share.
    if share.is_finite() { share } else { 1.0 }
}
