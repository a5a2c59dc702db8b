//! Times of passes: on the CPU to record them, and on the device by timestamp queries. The only file of this crate
//! that reads a clock, and only if times are requested.
//!
//! Timestamps arrive some frames later, through a ring of query sets. Nothing waits for the device; while the whole
//! ring is pending, a frame has no times.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;

use lodestream_threads::Instant;

use crate::frame::graph::PassId;
use crate::resources::gpu::Gpu;

/// Frames over which times are averaged.
const FRAMES: usize = 30;
/// Most frames with pending timestamps.
const RING: usize = 4;
/// Most timed intervals of a frame: its passes, each shadow map, each layer of occlusion twice, each level of the
/// depth pyramid and of bloom.
const INTERVALS: usize = 96;
/// Size of a timestamp in bytes.
const STAMP: u64 = wgpu::QUERY_SIZE as u64;

/// Times of a pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PassTime {
    /// The pass.
    pub pass: PassId,
    /// CPU time to record it.
    pub cpu: Duration,
    /// Time on the device from begin to end; `None` if the device has no timestamps
    /// ([`wgpu::Features::TIMESTAMP_QUERY`]) or none has arrived yet. On devices that overlap passes, these sum to
    /// more than the frame's time.
    pub gpu: Option<Duration>,
}

/// Mean times over the last frames, at most 30.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Timings {
    /// Number of frames averaged.
    pub frames: u32,
    /// CPU time of culling, planning and uploads.
    pub plan: Duration,
    /// The passes of the last frame in order, each averaged over the frames in which it ran.
    pub passes: Vec<PassTime>,
}

/// A frame's times.
#[derive(Debug)]
struct FrameTimes {
    number: u64,
    plan: Duration,
    cpu: Vec<(PassId, Duration)>,
    /// Per interval, once they have arrived.
    gpu: Option<Vec<(PassId, Duration)>>,
}

impl FrameTimes {
    fn gpu(&self, pass: PassId) -> Option<Duration> {
        // A pass without an interval did nothing.
        self.gpu.as_ref().map(|all| all.iter().filter(|(id, _)| *id == pass).map(|(_, time)| *time).sum())
    }

    fn cpu(&self, pass: PassId) -> Option<Duration> {
        self.cpu.iter().find(|(id, _)| *id == pass).map(|(_, time)| *time)
    }
}

/// States of a [`Slot`].
const FREE: u8 = 0;
const UNDER_WAY: u8 = 1;
const READABLE: u8 = 2;

/// Timestamps of a frame, pending or readable.
#[derive(Debug)]
struct Slot {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    readable: wgpu::Buffer,
    state: Arc<AtomicU8>,
    frame: u64,
    intervals: Vec<PassId>,
}

/// Callback for arrived timestamps. If a frame is never submitted, the callback is dropped and the slot becomes free.
struct ReadbackSignal(Arc<AtomicU8>);

impl ReadbackSignal {
    fn land(self, well: bool) {
        if well {
            self.0.store(READABLE, Ordering::Release);
        }
    }
}

impl Drop for ReadbackSignal {
    fn drop(&mut self) {
        let _ = self.0.compare_exchange(UNDER_WAY, FREE, Ordering::AcqRel, Ordering::Relaxed);
    }
}

impl Slot {
    fn new(gpu: &Gpu) -> Self {
        let count = 2 * INTERVALS as u32;
        let buffer = |usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("timestamps"),
                size: u64::from(count) * STAMP,
                usage,
                mapped_at_creation: false,
            })
        };
        Self {
            queries: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count,
            }),
            resolved: buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            readable: buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ),
            state: Arc::new(AtomicU8::new(FREE)),
            frame: 0,
            intervals: Vec::new(),
        }
    }

    /// Records the readback of a frame's timestamps.
    fn send(&mut self, encoder: &wgpu::CommandEncoder, frame: u64, intervals: Vec<PassId>) {
        (self.frame, self.intervals) = (frame, intervals);
        self.state.store(UNDER_WAY, Ordering::Release);
        let landing = ReadbackSignal(Arc::clone(&self.state));
        encoder.map_buffer_on_submit(&self.readable, wgpu::MapMode::Read, .., move |result| {
            landing.land(result.is_ok());
        });
    }

    /// Takes arrived timestamps.
    fn take(&mut self, period_ns: f64) -> Option<(u64, Vec<(PassId, Duration)>)> {
        if self.state.load(Ordering::Acquire) != READABLE {
            return None;
        }
        let stamps: Vec<u64> = self
            .readable
            .get_mapped_range(..)
            .map(|mapped| bytemuck::pod_collect_to_vec(&mapped))
            .unwrap_or_default();
        self.readable.unmap();
        self.state.store(FREE, Ordering::Release);
        let times = self.intervals.drain(..).zip(stamps.chunks_exact(2)).map(|(pass, ends)| {
            // Device clocks may go backwards.
            let ticks = ends[1].saturating_sub(ends[0]);
            // Far below 2^53 ticks.
            (pass, Duration::from_secs_f64(ticks as f64 * period_ns * 1e-9))
        });
        Some((self.frame, times.collect()))
    }
}

/// Keeps the times of the last frames.
#[derive(Debug)]
pub(crate) struct Timer {
    ring: Vec<Slot>,
    period_ns: f64,
    frames: u64,
    last: VecDeque<FrameTimes>,
}

impl Timer {
    /// With timestamps where the device has them.
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let stamps = gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        Self {
            ring: (0..if stamps { RING } else { 0 }).map(|_| Slot::new(gpu)).collect(),
            period_ns: f64::from(gpu.queue.get_timestamp_period()),
            frames: 0,
            last: VecDeque::new(),
        }
    }

    /// Begins a frame.
    pub(crate) fn begin(&mut self) -> FrameTimer {
        self.collect();
        self.frames += 1;
        let free = self.ring.iter().position(|slot| slot.state.load(Ordering::Acquire) == FREE);
        FrameTimer {
            number: self.frames,
            stamps: free.map(|slot| (slot, self.ring[slot].queries.clone())),
            intervals: Vec::new(),
            lap: Instant::now(),
            plan: Duration::ZERO,
            cpu: Vec::new(),
        }
    }

    /// Ends the recording of a frame.
    pub(crate) fn end(&mut self, frame: FrameTimer, encoder: &mut wgpu::CommandEncoder) {
        let FrameTimer { number, stamps, intervals, plan, mut cpu, .. } = frame;
        // Shadow maps are recorded before all other passes.
        cpu.sort_by_key(|(pass, _)| *pass);
        if let Some((slot, _)) = stamps
            && !intervals.is_empty()
        {
            let slot = &mut self.ring[slot];
            let count = 2 * intervals.len() as u32;
            encoder.resolve_query_set(&slot.queries, 0..count, &slot.resolved, 0);
            encoder.copy_buffer_to_buffer(&slot.resolved, 0, &slot.readable, 0, u64::from(count) * STAMP);
            slot.send(encoder, number, intervals);
        }
        if self.last.len() >= FRAMES {
            self.last.pop_front();
        }
        self.last.push_back(FrameTimes { number, plan, cpu, gpu: None });
    }

    fn collect(&mut self) {
        for (number, times) in self.ring.iter_mut().filter_map(|slot| slot.take(self.period_ns)) {
            if let Some(frame) = self.last.iter_mut().find(|frame| frame.number == number) {
                frame.gpu = Some(times);
            }
        }
    }

    /// Means over the last frames.
    pub(crate) fn timings(&mut self) -> Timings {
        self.collect();
        let Some(newest) = self.last.back() else { return Timings::default() };
        let times = |&(pass, _): &(PassId, Duration)| PassTime {
            pass,
            cpu: mean(self.last.iter().filter_map(|frame| frame.cpu(pass))).unwrap_or_default(),
            gpu: mean(self.last.iter().filter(|f| f.cpu(pass).is_some()).filter_map(|f| f.gpu(pass))),
        };
        Timings {
            frames: self.last.len() as u32,
            plan: mean(self.last.iter().map(|frame| frame.plan)).unwrap_or_default(),
            passes: newest.cpu.iter().map(times).collect(),
        }
    }
}

fn mean(times: impl Iterator<Item = Duration>) -> Option<Duration> {
    let (sum, count) = times.fold((Duration::ZERO, 0), |(sum, count), time| (sum + time, count + 1));
    (count > 0).then(|| sum / count)
}

/// The times of the frame that is being recorded.
#[derive(Debug)]
pub(crate) struct FrameTimer {
    number: u64,
    /// The ring's slot, and its queries.
    stamps: Option<(usize, wgpu::QuerySet)>,
    intervals: Vec<PassId>,
    lap: Instant,
    plan: Duration,
    cpu: Vec<(PassId, Duration)>,
}

impl FrameTimer {
    fn lap(&mut self) -> Duration {
        let now = Instant::now();
        now - std::mem::replace(&mut self.lap, now)
    }

    /// The query index for the begin of an interval; the end follows it.
    fn interval(&mut self, pass: PassId) -> Option<(&wgpu::QuerySet, u32)> {
        let (_, query_set) = self.stamps.as_ref()?;
        let first = (self.intervals.len() < INTERVALS).then_some(2 * self.intervals.len() as u32)?;
        self.intervals.push(pass);
        Some((query_set, first))
    }
}

/// A command encoder that times what is recorded with it, if requested.
pub(crate) struct PassEncoder<'e> {
    pub(crate) encoder: &'e mut wgpu::CommandEncoder,
    timer: Option<FrameTimer>,
}

impl<'e> PassEncoder<'e> {
    pub(crate) fn new(encoder: &'e mut wgpu::CommandEncoder, timer: Option<FrameTimer>) -> Self {
        Self { encoder, timer }
    }

    /// Begins a render pass, as a timed interval.
    pub(crate) fn begin(
        &mut self,
        pass: PassId,
        descriptor: &wgpu::RenderPassDescriptor<'_>,
    ) -> wgpu::RenderPass<'_> {
        let writes = self.timer.as_mut().and_then(|timer| timer.interval(pass)).map(|(query_set, first)| {
            wgpu::RenderPassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(first),
                end_of_pass_write_index: Some(first + 1),
            }
        });
        self.encoder
            .begin_render_pass(&wgpu::RenderPassDescriptor { timestamp_writes: writes, ..descriptor.clone() })
    }

    /// Begins a compute pass, as a timed interval.
    pub(crate) fn begin_compute(&mut self, pass: PassId) -> wgpu::ComputePass<'_> {
        let writes = self.timer.as_mut().and_then(|timer| timer.interval(pass)).map(|(query_set, first)| {
            wgpu::ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(first),
                end_of_pass_write_index: Some(first + 1),
            }
        });
        let descriptor = wgpu::ComputePassDescriptor { label: Some(pass.name()), timestamp_writes: writes };
        self.encoder.begin_compute_pass(&descriptor)
    }

    /// Attributes the time since the last lap to planning.
    pub(crate) fn planned(&mut self) {
        if let Some(timer) = &mut self.timer {
            let time = timer.lap();
            timer.plan += time;
        }
    }

    /// Attributes the time since the last lap to recording a pass.
    pub(crate) fn recorded(&mut self, pass: PassId) {
        let Some(timer) = &mut self.timer else { return };
        let time = timer.lap();
        match timer.cpu.iter_mut().find(|(id, _)| *id == pass) {
            Some((_, sum)) => *sum += time,
            None => timer.cpu.push((pass, time)),
        }
    }

    /// Hands the times over.
    pub(crate) fn end(self, timer: Option<&mut Timer>) {
        if let (Some(frame), Some(timer)) = (self.timer, timer) {
            timer.end(frame, self.encoder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn means_are_over_frames_in_which_a_pass_ran_and_whose_stamps_are_back() {
        let frame = |number, cpu: &[(PassId, u64)], gpu: Option<&[(PassId, u64)]>| {
            let times = |all: &[(PassId, u64)]| all.iter().map(|&(pass, time)| (pass, ms(time))).collect();
            FrameTimes { number, plan: ms(number), cpu: times(cpu), gpu: gpu.map(times) }
        };
        let (sky, maps, tone) = (PassId::Sky, PassId::ShadowMaps, PassId::ToneMap);
        let mut timer = Timer {
            ring: Vec::new(),
            period_ns: 1.0,
            frames: 3,
            last: VecDeque::from([
                frame(1, &[(sky, 8), (tone, 2)], Some(&[(sky, 9), (tone, 4)])),
                // Two shadow maps are two intervals of one pass.
                frame(2, &[(maps, 1), (tone, 4)], Some(&[(maps, 5), (maps, 6), (tone, 6)])),
                frame(3, &[(maps, 3), (tone, 6)], None),
            ]),
        };
        let Timings { frames, plan, passes } = timer.timings();
        assert_eq!((frames, plan), (3, ms(2)));
        assert_eq!(
            passes,
            [
                PassTime { pass: maps, cpu: ms(2), gpu: Some(ms(11)) },
                PassTime { pass: tone, cpu: ms(4), gpu: Some(ms(5)) },
            ]
        );
    }

    #[test]
    fn a_frame_that_is_never_submitted_leaves_its_slot_free() {
        let state = Arc::new(AtomicU8::new(UNDER_WAY));
        drop(ReadbackSignal(Arc::clone(&state)));
        assert_eq!(state.load(Ordering::Relaxed), FREE);
        state.store(UNDER_WAY, Ordering::Relaxed);
        ReadbackSignal(Arc::clone(&state)).land(true);
        assert_eq!(state.load(Ordering::Relaxed), READABLE);
    }
}
