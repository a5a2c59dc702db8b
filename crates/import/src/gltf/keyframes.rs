//! Reads the keyframes of a file's animations. Sizes are checked before anything is read.

use std::collections::BTreeMap;

use gltf::json::accessor::Type;
use lodestream_scene::animation::{
    AnimatedModel, Channel, Clip, Interpolation, MAX_CLIP_NAME_BYTES, MAX_CLIPS, MAX_ENTRIES, Property,
};

use super::accessor::Buffers;
use super::animation_json::{Animation, Sampler, Target};
use super::animation_left_out::LeftOut;
use super::container::Document;

/// Most numbers in the keyframes of a file: they must fit a blob.
const MAX_NUMBERS: usize = 3 << 20;
/// The same for each byte of the file's buffers, besides a few: channels may share their bytes, but not all.
const NUMBERS_PER_BYTE: usize = 2;
const FEW_NUMBERS: usize = 1 << 10;

/// Reads the keyframes of channels.
pub(super) struct Keyframes<'a> {
    document: &'a Document,
    buffers: Buffers<'a>,
    numbers: &'a BTreeMap<usize, u32>,
    left_out: &'a mut LeftOut,
    /// Timelines by the accessor of their times, and whether only the ends are in them.
    timelines: BTreeMap<(usize, bool), u32>,
    /// Numbers that may still be read.
    room: usize,
}

impl<'a> Keyframes<'a> {
    pub(super) fn new(
        document: &'a Document,
        numbers: &'a BTreeMap<usize, u32>,
        left_out: &'a mut LeftOut,
    ) -> Self {
        let buffers = Buffers::new(document);
        let bytes: u64 = document.root.buffers.iter().map(|buffer| buffer.byte_length.0).sum();
        let bytes = usize::try_from(bytes).unwrap_or(usize::MAX);
        let room = bytes.saturating_mul(NUMBERS_PER_BYTE).saturating_add(FEW_NUMBERS).min(MAX_NUMBERS);
        Self { document, buffers, numbers, left_out, timelines: BTreeMap::new(), room }
    }

    /// Adds the clips that move nodes with numbers.
    pub(super) fn add_clips(mut self, animations: &[Animation], model: &mut AnimatedModel) {
        let mut names: BTreeMap<String, usize> = BTreeMap::new();
        for (number, animation) in animations.iter().enumerate() {
            if model.clips.len() >= MAX_CLIPS {
                self.left_out.too_long = true;
                break;
            }
            let mut channels: Vec<Channel> = Vec::new();
            for (at, channel) in animation.channels.iter().enumerate() {
                let (Target::Node(property), Some(file_node)) = (channel.target, channel.node) else {
                    continue;
                };
                let Some(&node) = self.numbers.get(&file_node) else { continue };
                if channels.len() >= MAX_ENTRIES {
                    self.left_out.too_long = true;
                    break;
                }
                let place = format!("animations[{number}].channels[{at}]");
                let sampler = animation.samplers.get(channel.sampler);
                match self.channel(&place, sampler, (node, property), &mut model.timelines) {
                    Ok(channel) => channels.extend(channel),
                    Err(why) => {
                        self.left_out.unreadable += 1;
                        self.left_out.first.get_or_insert(why);
                    }
                }
            }
            if channels.is_empty() {
                continue;
            }
            let own = animation.name.as_deref().filter(|name| !name.is_empty());
            let name = own.map_or_else(|| format!("animation {number}"), str::to_owned);
            // Room for a number.
            let name = name[..name.floor_char_boundary(MAX_CLIP_NAME_BYTES - 8)].to_owned();
            let count = names.entry(name.clone()).or_default();
            *count += 1;
            let name = if *count == 1 { name } else { format!("{name}-{count}") };
            model.clips.push(Clip { name, channels });
        }
    }

    fn has(&self, accessor: usize) -> bool {
        accessor < self.document.root.accessors.len()
    }

    /// The keyframes of a channel; `None` if they no longer fit.
    fn channel(
        &mut self,
        place: &str,
        sampler: Option<&Sampler>,
        (node, property): (u32, Property),
        timelines: &mut Vec<Vec<f32>>,
    ) -> Result<Option<Channel>, String> {
        let sampler = sampler.ok_or_else(|| format!("{place} has a sampler that does not exist"))?;
        let Some(interpolation) = sampler.interpolation else {
            return Err(format!("{place} has an unknown interpolation"));
        };
        let mut channel = Channel { node, property, interpolation, timeline: 0, values: Vec::new() };
        let (input, output) = (format!("{place}: its input"), format!("{place}: its output"));
        let shape = if property == Property::Rotation { Type::Vec4 } else { Type::Vec3 };
        let count = |accessor: usize| self.document.root.accessors.get(accessor).map_or(0, |a| a.count);
        let keyframes = usize::try_from(count(sampler.input)).unwrap_or(usize::MAX);
        let needed = channel.values_for(keyframes);
        // Checked, and counted, before anything is read: accessors may share their bytes.
        self.room = match self.room.checked_sub(needed.saturating_add(keyframes)) {
            Some(room) => room,
            None => {
                self.left_out.too_long = true;
                return Ok(None);
            }
        };
        let components = property.components();
        let stated = count(sampler.output);
        if keyframes == 0 || self.has(sampler.output) && stated != (needed / components) as u64 {
            return Err(format!("{place} has {keyframes} times for {stated} values"));
        }
        let opened = self.buffers.open(sampler.output, &output, &[shape]).map_err(|why| why.to_string())?;
        channel.values = (0..opened.len())
            .flat_map(|at| opened.get::<4>(at).into_iter().take(components))
            .map(|value| value as f32)
            .collect();
        if !channel.values.iter().all(|value| value.is_finite()) {
            return Err(format!("{place} has values that are not finite"));
        }
        let times =
            self.buffers.open(sampler.input, &input, &[Type::Scalar]).map_err(|why| why.to_string())?;
        let mut times: Vec<f32> = (0..times.len()).map(|at| times.get::<1>(at)[0] as f32).collect();
        if !times.is_sorted_by(|a, b| a < b) || !times.iter().all(|t| t.is_finite() && *t >= 0.0) {
            return Err(format!("{place} has times that do not ascend from 0"));
        }
        // What stays the same needs two keyframes: the second keeps the duration.
        let same = channel.values.chunks(components).all(|value| value == &channel.values[..components]);
        let ends = interpolation != Interpolation::CubicSpline && keyframes > 2 && same;
        if ends {
            channel.values.truncate(2 * components);
            times = vec![times[0], times[keyframes - 1]];
        }
        channel.timeline = match self.timelines.get(&(sampler.input, ends)) {
            Some(&known) => known,
            None if timelines.len() >= MAX_ENTRIES => {
                self.left_out.too_long = true;
                return Ok(None);
            }
            None => {
                let number = u32::try_from(timelines.len()).unwrap_or(u32::MAX);
                timelines.push(times);
                self.timelines.insert((sampler.input, ends), number);
                number
            }
        };
        Ok(Some(channel))
    }
}
