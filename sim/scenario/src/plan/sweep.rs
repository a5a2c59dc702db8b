//! Sweeps: expands axes into cases.

use std::collections::BTreeMap;
use std::path::{Component, Path};
use std::sync::Arc;

use lodestream_bake::preparation_settings::PositionBits;
use lodestream_netsim::link::{IP_UDP_BYTES, LinkSettings, Loss};
use serde::Deserialize;

use super::axis::Axis;
use super::camera::{self, CameraFile};
use super::link::{BurstFile, Direction, LinkFile};
use super::seeds::Seeds;
use super::{Case, CaseLink, Fault, PlanScene, SceneChoice, Transport};
use crate::camera_path::CameraPath;
use crate::field::Field;
use crate::published_scene::ENDING;
use crate::technique::Technique;

/// Most runs of one plan: a mistake in a list should not cost hours.
pub(super) const MAX_RUNS: usize = 10_000;

/// Smallest packets that QUIC works over: datagrams of 1,200 bytes (RFC 9000, §14) and headers.
const MIN_QUIC_MTU_BYTES: u32 = 1200 + IP_UDP_BYTES;

/// Prefix of the name of a scene that is a single model.
const MODEL: &str = "model:";

/// Prefix of the name of a generated scene of a given size.
const FIELD: &str = "field:";
/// What the name of a city begins with.
const CITY: &str = "city:";

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sweep {
    transport: Axis<Transport>,
    resumed: Option<Axis<bool>>,
    scene: Option<Axis<String>>,
    link: Option<Axis<String>>,
    rate_bits_per_s: Option<Axis<u64>>,
    rtt_ms: Option<Axis<f64>>,
    loss: Option<Axis<f64>>,
    burst_loss: Option<Vec<BurstFile>>,
    jitter_ms: Option<Axis<f64>>,
    reorder: Option<bool>,
    queue_bytes: Option<Axis<u64>>,
    mtu_bytes: Option<Axis<u32>>,
    up: Option<Direction>,
    camera: Option<Axis<String>>,
    technique: Option<Axis<Technique>>,
    limiter_share: Option<f64>,
    limiter_bits_per_s: Option<u64>,
    time_limit_s: Option<f64>,
    seeds: Option<Seeds>,
}

/// An axis and the index of one of its values, for messages.
type AxisValue = (&'static str, usize);

/// The parts of a plan that its sweeps refer to.
pub(super) struct SweepContext<'a> {
    /// Folder that scene and trace files are relative to.
    pub(super) folder: &'a Path,
    /// The scene of sweeps that name none.
    pub(super) scene: &'a str,
    pub(super) position_bits: Option<PositionBits>,
    /// Default of sweeps.
    pub(super) time_limit_s: f64,
    /// Default of sweeps.
    pub(super) seeds: &'a Seeds,
    pub(super) links: &'a BTreeMap<String, LinkFile>,
    pub(super) cameras: &'a BTreeMap<String, CameraFile>,
}

/// Expands sweeps into cases.
pub(super) struct CaseBuilder<'a> {
    folder: &'a Path,
    scene: &'a str,
    position_bits: Option<PositionBits>,
    time_limit_s: f64,
    seeds: Arc<[u64]>,
    links: BTreeMap<&'a str, CaseLink>,
    cameras: BTreeMap<&'a str, CameraPath>,
    scenes: Vec<PlanScene>,
    cases: Vec<Case>,
    runs: usize,
}

impl<'a> CaseBuilder<'a> {
    /// Checks the plan's links, cameras, scene, seeds and time limit.
    pub(super) fn new(context: &SweepContext<'a>) -> Result<Self, Fault> {
        let folder = context.folder;
        let mut links = BTreeMap::new();
        for (name, file) in context.links {
            let table = format!("link.{name}");
            let down = file.down.settings(folder).map_err(|fault| fault.within("down").within(&table))?;
            let up = file.up.as_ref().map_or_else(|| file.down.clone(), |up| up.or(&file.down));
            let up = up.settings(folder).map_err(|fault| fault.within("up").within(&table))?;
            links.insert(name.as_str(), CaseLink { name: name.clone(), down, up });
        }
        let mut cameras = BTreeMap::new();
        for (name, file) in context.cameras {
            let path = file.check().map_err(|fault| fault.within(&format!("camera.{name}")))?;
            cameras.insert(name.as_str(), path);
        }
        let mut builder = Self {
            folder,
            scene: context.scene,
            position_bits: context.position_bits,
            time_limit_s: time_limit(context.time_limit_s)?,
            seeds: context.seeds.list()?,
            links,
            cameras,
            scenes: Vec::new(),
            cases: Vec::new(),
            runs: 0,
        };
        // The plan's scene is the first, and is checked even if every sweep names another.
        builder.scene(context.scene).map_err(|message| Fault::new("scene", message))?;
        Ok(builder)
    }

    /// The scenes that cases use, renumbered, and the cases.
    pub(super) fn finish(mut self) -> (Vec<PlanScene>, Vec<Case>) {
        let mut used = Vec::new();
        for case in &mut self.cases {
            let place = used.iter().position(|&scene| scene == case.scene);
            case.scene = place.unwrap_or_else(|| {
                used.push(case.scene);
                used.len() - 1
            });
        }
        (used.into_iter().map(|scene| self.scenes[scene].clone()).collect(), self.cases)
    }

    fn scene(&mut self, name: &str) -> Result<usize, &'static str> {
        if let Some(known) = self.scenes.iter().position(|scene| scene.name == name) {
            return Ok(known);
        }
        let choice = scene_choice(name, self.folder, self.position_bits)?;
        self.scenes.push(PlanScene { name: name.to_owned(), choice });
        Ok(self.scenes.len() - 1)
    }

    fn camera(&self, name: &str) -> Result<CameraPath, String> {
        let known = self.cameras.get(name).copied().or_else(|| camera::by_name(name));
        known.ok_or_else(|| {
            format!(
                "there is no camera path {name:?}; use \"still\", \"orbit\", \"fly-through\", \"teleport\" or \
                 \"swing\", or add a [camera.{name}]"
            )
        })
    }

    /// Adds the cases of a sweep.
    pub(super) fn expand(&mut self, sweep: &Sweep) -> Result<(), Fault> {
        let transports = sweep.transports()?;
        let scenes = values("scene", sweep.scene.as_ref(), &[self.scene.to_owned()])?;
        let cameras = values("camera", sweep.camera.as_ref(), &["still".to_owned()])?;
        let techniques = values("technique", sweep.technique.as_ref(), &[Technique::Lodestream])?;
        let limited = sweep.limiter_share.is_some() || sweep.limiter_bits_per_s.is_some();
        if limited && let Some(t) = techniques.iter().position(|&t| t != Technique::Lodestream) {
            let message = format!("{} has no limiter; give it a sweep without one", techniques[t]);
            return Err(Fault::new(format!("technique[{t}]"), message));
        }
        if let Some(t) = techniques.iter().position(|&t| t != Technique::Lodestream)
            && transports.iter().any(|(_, resumed)| *resumed)
        {
            let message = format!(
                "{} over resumed connections is not simulated; give it a sweep of its own",
                techniques[t]
            );
            return Err(Fault::new(format!("technique[{t}]"), message));
        }
        if let Some(t) = techniques.iter().position(|&t| t == Technique::Published)
            && transports.iter().any(|(transport, _)| *transport != Transport::Ws)
        {
            let message = "published scenes come over TCP: give it a sweep with transport \"ws\"";
            return Err(Fault::new(format!("technique[{t}]"), message));
        }
        let seeds = sweep.seeds.as_ref().map_or_else(|| Ok(Arc::clone(&self.seeds)), Seeds::list)?;
        let limit = sweep.time_limit_s.map_or(Ok(self.time_limit_s), time_limit)?;
        // Counted before expansion: the product of four long lists can exceed the memory.
        let link_cases = sweep.link_cases()?;
        let product = [transports.len(), scenes.len(), cameras.len(), techniques.len(), seeds.len()]
            .iter()
            .try_fold(link_cases, |product, length| product.checked_mul(*length));
        self.runs = product.and_then(|runs| runs.checked_add(self.runs)).unwrap_or(usize::MAX);
        if self.runs > MAX_RUNS {
            let field = if sweep.link.is_some() { "link" } else { "rate_bits_per_s" };
            return Err(Fault::new(field, format!("the plan has more than {MAX_RUNS} runs; shorten a list")));
        }
        let links = self.links(sweep)?;
        for (s, scene) in scenes.iter().enumerate() {
            let fault = |message: &str| Fault::new(format!("scene[{s}]"), message);
            let scene = self.scene(scene).map_err(fault)?;
            for &(transport, resumed) in &transports {
                for (link, places) in &links {
                    check_transport(transport, link, places)?;
                    let limiter_bits_per_s = sweep.limiter(&link.down)?;
                    for (c, camera) in cameras.iter().enumerate() {
                        let path =
                            self.camera(camera).map_err(|why| Fault::new(format!("camera[{c}]"), why))?;
                        self.cases.extend(techniques.iter().map(|&technique| Case {
                            scene,
                            transport,
                            resumed,
                            link: link.clone(),
                            camera: camera.clone(),
                            path,
                            technique,
                            peer: None,
                            limiter_bits_per_s,
                            time_limit_s: limit,
                            seeds: Arc::clone(&seeds),
                        }));
                    }
                }
            }
        }
        Ok(())
    }

    /// The links of a sweep, each with the axis values that define it.
    fn links(&self, sweep: &Sweep) -> Result<Vec<(CaseLink, Vec<AxisValue>)>, Fault> {
        let Some(names) = &sweep.link else { return sweep.axes(self.folder) };
        let mut links = Vec::new();
        for (i, name) in names.0.iter().enumerate() {
            let link = self.links.get(name.as_str()).ok_or_else(|| {
                Fault::new(format!("link[{i}]"), format!("there is no link {name:?}; add a [link.{name}]"))
            })?;
            links.push((link.clone(), vec![("link", i)]));
        }
        Ok(links)
    }
}

impl Sweep {
    /// The transports, each with whether its connections are resumed.
    fn transports(&self) -> Result<Vec<(Transport, bool)>, Fault> {
        let transports = values("transport", Some(&self.transport), &[])?;
        let resumed = values("resumed", self.resumed.as_ref(), &[false])?;
        if transports.contains(&Transport::Ws)
            && let Some(i) = resumed.iter().position(|resumed| *resumed)
        {
            let message =
                "true over \"ws\": only QUIC connections are resumed; give \"ws\" a sweep without it";
            return Err(Fault::new(format!("resumed[{i}]"), message));
        }
        let with = |&transport| resumed.iter().map(move |&resumed| (transport, resumed));
        Ok(transports.iter().flat_map(with).collect())
    }

    /// Number of links of the sweep. Refuses keys that contradict each other.
    fn link_cases(&self) -> Result<usize, Fault> {
        let lengths = [
            ("rate_bits_per_s", self.rate_bits_per_s.as_ref().map(|axis| axis.0.len())),
            ("rtt_ms", self.rtt_ms.as_ref().map(|axis| axis.0.len())),
            ("loss", self.loss.as_ref().map(|axis| axis.0.len())),
            ("burst_loss", self.burst_loss.as_ref().map(Vec::len)),
            ("jitter_ms", self.jitter_ms.as_ref().map(|axis| axis.0.len())),
            ("queue_bytes", self.queue_bytes.as_ref().map(|axis| axis.0.len())),
            ("mtu_bytes", self.mtu_bytes.as_ref().map(|axis| axis.0.len())),
        ];
        let is_empty = |length: Option<usize>| length == Some(0);
        if let Some((name, _)) = lengths.iter().find(|(_, length)| is_empty(*length)) {
            return Err(Fault::new(*name, "is empty; it needs at least one value"));
        }
        if let Some(names) = &self.link {
            let axis = lengths.iter().find(|(_, length)| length.is_some()).map(|(name, _)| *name);
            let other =
                axis.or(self.reorder.is_some().then_some("reorder")).or(self.up.is_some().then_some("up"));
            if let Some(field) = other {
                let message = "conflicts with `link`; put it into the link's table, or leave out `link`";
                return Err(Fault::new(field, message));
            }
            values("link", Some(names), &[])?;
            return Ok(names.0.len());
        }
        for (field, given) in [("rate_bits_per_s", lengths[0].1), ("rtt_ms", lengths[1].1)] {
            if given.is_none() {
                return Err(Fault::new(field, "is missing; give it, or name a `link`"));
            }
        }
        let times = self.rtt_ms.iter().flat_map(|axis| &axis.0).enumerate();
        if let Some((i, rtt)) = times.into_iter().find(|(_, rtt)| !(0.0..=3_600_000.0).contains(*rtt)) {
            return Err(Fault::new(
                format!("rtt_ms[{i}]"),
                format!("{rtt} is not a time from 0 to 3.6e6 ms"),
            ));
        }
        if self.loss.is_some() && self.burst_loss.is_some() {
            return Err(Fault::new("loss", "burst_loss is given too; keep one of them"));
        }
        let product =
            lengths.iter().try_fold(1_usize, |product, (_, length)| product.checked_mul(length.unwrap_or(1)));
        Ok(product.unwrap_or(usize::MAX))
    }

    /// The links of the axes' combinations.
    fn axes(&self, folder: &Path) -> Result<Vec<(CaseLink, Vec<AxisValue>)>, Fault> {
        let mut links: Vec<(Direction, Vec<AxisValue>)> =
            vec![(Direction { reorder: self.reorder, ..Direction::default() }, Vec::new())];
        let rates = self.rate_bits_per_s.as_ref().map(|axis| axis.0.as_slice());
        links = cross(links, "rate_bits_per_s", rates, |link, rate| link.rate_bits_per_s = Some(rate));
        let times = self.rtt_ms.as_ref().map(|axis| axis.0.as_slice());
        // Doubling and halving are exact in binary numbers.
        links = cross(links, "rtt_ms", times, |link, rtt| link.delay_ms = Some(rtt / 2.0));
        let losses = self.loss.as_ref().map(|axis| axis.0.as_slice());
        links = cross(links, "loss", losses, |link, loss| link.loss = Some(loss));
        let bursts = self.burst_loss.as_deref();
        links = cross(links, "burst_loss", bursts, |link, burst| link.burst_loss = Some(burst));
        let jitters = self.jitter_ms.as_ref().map(|axis| axis.0.as_slice());
        links = cross(links, "jitter_ms", jitters, |link, jitter| link.jitter_ms = Some(jitter));
        let queues = self.queue_bytes.as_ref().map(|axis| axis.0.as_slice());
        links = cross(links, "queue_bytes", queues, |link, queue| link.queue_bytes = Some(queue));
        let mtus = self.mtu_bytes.as_ref().map(|axis| axis.0.as_slice());
        links = cross(links, "mtu_bytes", mtus, |link, mtu| link.mtu_bytes = Some(mtu));
        let made = links.into_iter().map(|(direction, places)| {
            let down = direction.settings(folder).map_err(|fault| with_index(fault, &places))?;
            let up = match &self.up {
                None => down.clone(),
                Some(up) => up.or(&direction).settings(folder).map_err(|fault| fault.within("up"))?,
            };
            let name = describe(&down, &up);
            Ok((CaseLink { name, down, up }, places))
        });
        made.collect()
    }

    fn limiter(&self, down: &LinkSettings) -> Result<Option<u64>, Fault> {
        match (self.limiter_share, self.limiter_bits_per_s) {
            (None, None) => Ok(None),
            (Some(_), Some(_)) => {
                Err(Fault::new("limiter_share", "limiter_bits_per_s is given too; keep one of them"))
            }
            (Some(share), None) if !(0.01..=100.0).contains(&share) => {
                Err(Fault::new("limiter_share", format!("{share} is not a share from 0.01 to 100")))
            }
            (Some(share), None) => match down.rate.as_constant() {
                Some(rate) => Ok(Some((rate.get() as f64 * share).round() as u64)),
                None => Err(Fault::new(
                    "limiter_share",
                    "the link's rate varies, so a share of it is undefined; give limiter_bits_per_s",
                )),
            },
            (None, Some(rate)) if !(1000..=1_000_000_000_000).contains(&rate) => {
                Err(Fault::new("limiter_bits_per_s", format!("{rate} is not a rate from 1e3 to 1e12 bit/s")))
            }
            (None, rate) => Ok(rate),
        }
    }
}

/// Checks a time limit, in seconds.
fn time_limit(seconds: f64) -> Result<f64, Fault> {
    if seconds > 0.0 && seconds <= 1e6 {
        Ok(seconds)
    } else {
        Err(Fault::new("time_limit_s", format!("{seconds} is not a time from 0 to 1e6 seconds")))
    }
}

/// Parses the name of a scene; files are relative to `folder`.
pub(super) fn scene_choice(
    name: &str,
    folder: &Path,
    position_bits: Option<PositionBits>,
) -> Result<SceneChoice, &'static str> {
    let choice = match name {
        "" => {
            return Err("is empty; name \"demo\", \"demo-small\", \"city:1000\", \"empty\" or a scene.toml");
        }
        "demo" => SceneChoice::Demo,
        "demo-small" => SceneChoice::DemoSmall,
        "empty" => SceneChoice::Empty,
        model if model.starts_with(MODEL) => {
            let file = &model[MODEL.len()..];
            if file.is_empty() || !Path::new(file).components().all(|c| matches!(c, Component::Normal(_))) {
                return Err("names no file within the folder of models, as \"model:bunny.obj\" does");
            }
            SceneChoice::Model { file: file.to_owned(), folder: None, position_bits }
        }
        city if city.starts_with(CITY) => {
            let parts =
                city[CITY.len()..].parse().map_err(|_| "needs a number of parts, as \"city:1000\" has")?;
            SceneChoice::City(parts)
        }
        field if field.starts_with(FIELD) => SceneChoice::Field(Field::parse(&field[FIELD.len()..])?),
        url if url.ends_with(ENDING) && (url.contains("://") || url.starts_with("file:")) => {
            SceneChoice::Published(url.to_owned())
        }
        file if file.ends_with(ENDING) => {
            SceneChoice::Published(folder.join(file).to_string_lossy().into_owned())
        }
        other => SceneChoice::File(folder.join(other)),
    };
    Ok(choice)
}

/// The values of an axis, or the default if the axis is absent.
fn values<T: Clone>(name: &str, axis: Option<&Axis<T>>, default: &[T]) -> Result<Vec<T>, Fault> {
    let values = axis.map_or_else(|| default.to_vec(), |axis| axis.0.clone());
    if values.is_empty() {
        Err(Fault::new(name, "is empty; it needs at least one value"))
    } else {
        Ok(values)
    }
}

/// Combines every link with every value of one more axis; the last axis changes fastest.
fn cross<T: Copy>(
    links: Vec<(Direction, Vec<AxisValue>)>,
    name: &'static str,
    values: Option<&[T]>,
    set: impl Fn(&mut Direction, T),
) -> Vec<(Direction, Vec<AxisValue>)> {
    let Some(values) = values else { return links };
    let with = |(link, places): &(Direction, Vec<AxisValue>)| {
        let (link, places) = (link.clone(), places.clone());
        let set = &set;
        let made = values.iter().enumerate().map(move |(i, &value)| {
            let (mut link, mut places) = (link.clone(), places.clone());
            set(&mut link, value);
            places.push((name, i));
            (link, places)
        });
        made.collect::<Vec<_>>()
    };
    links.iter().flat_map(with).collect()
}

/// Adds the index of the axis value that caused a fault.
fn with_index(fault: Fault, places: &[AxisValue]) -> Fault {
    let (axis, rest) = fault.field.split_once('.').unwrap_or((&fault.field, ""));
    let dot = if rest.is_empty() { "" } else { "." };
    match places.iter().find(|(name, _)| *name == axis) {
        Some((name, i)) => Fault::new(format!("{name}[{i}]{dot}{rest}"), fault.message),
        None => fault,
    }
}

/// Refuses links over which a transport is not modelled or cannot work.
fn check_transport(transport: Transport, link: &CaseLink, places: &[AxisValue]) -> Result<(), Fault> {
    for (way, settings) in [("down", &link.down), ("up", &link.up)] {
        let fault = |axis: &[&str], message: String| {
            let place = places.iter().find(|(name, _)| axis.contains(name));
            let field = place.map_or_else(|| axis[0].to_owned(), |(name, i)| format!("{name}[{i}]"));
            let own = link.down == link.up || way == "down" || place.is_some_and(|(name, _)| *name == "link");
            Err(Fault::new(if own { field } else { format!("up.{}", axis[0]) }, message))
        };
        match transport {
            Transport::Ws => {
                let loss = settings.loss.long_run();
                if loss > 0.0 {
                    let message = format!(
                        "{loss} {way} over \"ws\": TCP's recovery from loss is not modelled; use 0, or \"quic\""
                    );
                    return fault(&["loss", "burst_loss", "link"], message);
                }
                if settings.jitter.reorders && settings.jitter.largest_ns > 0 {
                    let message = format!(
                        "packets overtake each other {way} over \"ws\": TCP's recovery from that is not modelled; \
                         leave out `reorder`, or use \"quic\""
                    );
                    return fault(&["reorder", "link"], message);
                }
            }
            Transport::Quic if settings.mtu_bytes < MIN_QUIC_MTU_BYTES => {
                let message = format!(
                    "{} bytes {way}: QUIC needs packets of {MIN_QUIC_MTU_BYTES} bytes; use more, or \"ws\"",
                    settings.mtu_bytes
                );
                return fault(&["mtu_bytes", "link"], message);
            }
            Transport::Quic => {}
        }
    }
    Ok(())
}

/// Describes a link: rate, round trip and loss, and settings that differ from the default.
fn describe(down: &LinkSettings, up: &LinkSettings) -> String {
    let mbit = down.rate.first() as f64 / 1e6;
    let rtt_ms = (down.delay_ns + up.delay_ns) as f64 / 1e6;
    let loss_percent = (down.loss.long_run() * 1e6).round() / 1e4;
    let mut text = format!("{mbit} Mbit/s, RTT {rtt_ms} ms, loss {loss_percent} %");
    if let Loss::Burst(model) = down.loss {
        text += &format!(" in bursts of {:.1}", model.mean_bad_packets());
    }
    if down.jitter.largest_ns > 0 {
        text += &format!(", jitter {} ms", down.jitter.largest_ns as f64 / 1e6);
    }
    if down.queue_bytes != super::link::DEFAULT_QUEUE_BYTES {
        text += &format!(", queue {} bytes", down.queue_bytes);
    }
    if up.rate != down.rate {
        text += &format!(", {} Mbit/s up", up.rate.first() as f64 / 1e6);
    }
    text
}
