//! States of an asset's parts in GPU memory.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use glam::DVec3;
use lodestream_scene::parts::PartTransform;

use crate::resources::descriptors::texture_2d;
use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::vertex::MAX_PARTS;
use crate::scene::part_states::PartStates;
use crate::scene::part_words::PartWords;

/// `PART_STATES_WIDTH` of `mesh_vertex.wgsl`.
const WIDTH: usize = 1024;

/// What [`PartTable::set`] did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Written {
    Nothing,
    InPlace,
    /// Into a new texture, to be bound.
    NewTexture,
}

/// A texture of states, one word a texel: vertex stages need no storage buffer then, which not every device has.
#[derive(Debug, Default)]
pub(crate) struct PartTable {
    states: PartStates,
    words: Option<PartWords>,
    texture: Option<wgpu::Texture>,
    /// Number of the states; another for each change.
    version: u64,
    /// Whether a frame has drawn the states.
    drawn: AtomicBool,
    /// The states of the last frame that was drawn before the present ones, and their number.
    before: (u64, PartStates),
    /// Their words, if any part is moved in either: for motion vectors.
    words_before: Option<PartWords>,
    /// The transforms of each instance, each once, and those that hold its pose.
    moves: BTreeMap<u32, Vec<PartTransform>>,
    moves_of_others: Vec<PartTransform>,
}

/// A new number of states, unequal to 0.
fn new_version() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

impl PartTable {
    /// Replaces all states of an asset whose vertices are relative to `origin`. Cost: in proportion to the largest part
    /// listed of each instance, at most [`MAX_PARTS`]; twice that if parts are moved.
    pub(crate) fn set(
        &mut self,
        gpu: &Gpu,
        states: PartStates,
        origin: DVec3,
    ) -> Result<Written, RenderError> {
        if states == self.states {
            return Ok(Written::Nothing);
        }
        let last = states.instances.values().filter_map(|instance| instance.parts.last_key_value());
        if let Some((&part, _)) = last.max_by_key(|(part, _)| **part).filter(|(part, _)| **part >= MAX_PARTS)
        {
            return Err(RenderError::NoSuch {
                what: "part",
                index: part as usize,
                count: MAX_PARTS as usize,
            });
        }
        let was_drawn = self.drawn.load(Ordering::Relaxed);
        let before = if was_drawn { &self.states } else { &self.before.1 };
        let mut words = PartWords::new(&states, origin);
        let words_before = (states.moves() || before.moves()).then(|| words.append(before, origin));
        words.words.resize(words.words.len().next_multiple_of(WIDTH), 0);
        let rows = (words.words.len() / WIDTH) as u32;
        let allowed = gpu.device.limits().max_texture_dimension_2d;
        if rows > allowed {
            let bytes = |rows: u32| u64::from(rows) * 4 * WIDTH as u64;
            return Err(RenderError::TooLarge {
                what: "table of part states",
                needed: bytes(rows),
                allowed: bytes(allowed),
            });
        }
        self.texture.take_if(|texture| texture.height() < rows);
        let written = if self.texture.is_some() { Written::InPlace } else { Written::NewTexture };
        let texture = self.texture.get_or_insert_with(|| {
            let height = rows.next_power_of_two().min(allowed);
            let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
            let size = (WIDTH as u32, height);
            gpu.device.create_texture(&texture_2d("part states", size, wgpu::TextureFormat::R32Uint, usage))
        });
        gpu.queue.write_texture(
            texture.as_image_copy(),
            bytemuck::cast_slice(&words.words),
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(4 * WIDTH as u32),
                rows_per_image: None,
            },
            wgpu::Extent3d { width: WIDTH as u32, height: rows, depth_or_array_layers: 1 },
        );
        words.words = Vec::new();
        if was_drawn {
            self.before = (self.version, std::mem::take(&mut self.states));
        }
        self.moves_of_others = states.others.transform.into_iter().collect();
        let moves = states.instances.iter();
        let moves = moves.map(|(index, states)| (*index, PartTransform::distinct(states.transforms())));
        self.moves = moves.collect();
        for (index, pose) in &states.poses {
            self.moves.entry(*index).or_default().extend(pose.similarities());
        }
        (self.states, self.words, self.words_before) = (states, Some(words), words_before);
        (self.version, self.drawn) = (new_version(), AtomicBool::new(false));
        Ok(written)
    }

    /// The texture, once there are states.
    pub(crate) fn texture(&self) -> Option<&wgpu::Texture> {
        self.texture.as_ref()
    }

    /// To where parts of an instance are moved, each transform once.
    pub(crate) fn moves(&self, instance: usize) -> impl Iterator<Item = &PartTransform> {
        let listed = u32::try_from(instance).ok().and_then(|index| self.moves.get(&index));
        listed.unwrap_or(&self.moves_of_others).iter()
    }

    /// Whether any part is moved.
    pub(crate) fn moves_any(&self) -> bool {
        !self.moves_of_others.is_empty() || self.moves.values().any(|moves| !moves.is_empty())
    }

    /// Number of the states, which the next frame may give to [`PartTable::start_before`].
    pub(crate) fn version(&self) -> u64 {
        self.version
    }

    /// Where the states of this number begin, if they were the last that were drawn before the present ones and moves
    /// differ; else where the present ones do.
    pub(crate) fn start_before(&self, instance: usize, version: u64) -> Option<u32> {
        let before =
            self.words_before.as_ref().filter(|_| version != self.version && version == self.before.0);
        before.map_or_else(|| self.start(instance), |words| words.start(instance))
    }

    /// Where the states of an instance that is drawn begin, 0 without any; `None` if nothing of it is drawn.
    pub(crate) fn start(&self, instance: usize) -> Option<u32> {
        self.drawn.store(true, Ordering::Relaxed);
        self.words.as_ref().map_or(Some(0), |words| words.start(instance))
    }
}
