//! Comparison of virtual and real time.

use std::fmt;

use serde::Serialize;

use crate::plan::Transport;
use crate::result::RunResult;

/// A figure in virtual and in real time, in milliseconds since the connect call.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// "ttff", "ttq 4 px", "unoccluded ttq 4 px" …
    pub figure: String,
    /// In virtual time.
    pub virtual_ms: Option<f64>,
    /// Median of the repeats in real time, the lower of two; `None` if most never reached the milestone.
    pub real_ms: Option<f64>,
    /// Least value.
    pub real_least_ms: Option<f64>,
    /// Greatest value of the repeats that reached the milestone.
    pub real_greatest_ms: Option<f64>,
    /// Real minus virtual.
    pub difference_ms: Option<f64>,
    /// The same relative to the virtual time.
    pub difference_share: Option<f64>,
}

/// A case in virtual and in real time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// The scene's name in the plan.
    pub scene: String,
    /// Transport between client and server.
    pub transport: Transport,
    /// The link.
    pub link: String,
    /// The camera path's name.
    pub camera: String,
    /// Seed of loss and jitter.
    pub seed: u64,
    /// Number of runs in real time.
    pub repeats: usize,
    /// Bytes received in virtual time.
    pub virtual_bytes: u64,
    /// Their median in real time.
    pub real_bytes: u64,
    /// Times.
    pub differences: Vec<Difference>,
}

/// Compares the real-time repeats of a case with its run in virtual time.
#[must_use]
pub fn compare(simulated: &RunResult, real: &[RunResult]) -> Comparison {
    let figure = |name: String, of: &dyn Fn(&RunResult) -> Option<f64>| {
        let mut times: Vec<f64> = real.iter().map(|r| of(r).unwrap_or(f64::INFINITY)).collect();
        times.sort_by(f64::total_cmp);
        let arrived = |t: Option<f64>| t.filter(|t| t.is_finite());
        let (virtual_ms, real_ms) = (of(simulated), arrived(median(&times)));
        let difference_ms = virtual_ms.zip(real_ms).map(|(v, r)| r - v);
        Difference {
            figure: name,
            virtual_ms,
            real_ms,
            real_least_ms: arrived(times.first().copied()),
            real_greatest_ms: times.iter().rev().copied().find(|t| t.is_finite()),
            difference_ms,
            difference_share: difference_ms.zip(virtual_ms).filter(|(_, v)| *v > 0.0).map(|(d, v)| d / v),
        }
    };
    let mut differences = vec![figure("ttff".to_owned(), &|r| r.ttff_ms)];
    let mut qualities: Vec<&String> = simulated.ttq_ms.keys().collect();
    let size = |px: &str| px.parse().unwrap_or(0.0_f64);
    qualities.sort_by(|a, b| size(b).total_cmp(&size(a)));
    for px in &qualities {
        differences.push(figure(format!("ttq {px} px"), &|r| r.ttq_ms.get(*px).copied().flatten()));
    }
    for px in &qualities {
        differences.push(figure(format!("unoccluded ttq {px} px"), &|r| {
            r.unoccluded_ttq_ms.get(*px).copied().flatten()
        }));
    }
    differences.push(figure("settled".to_owned(), &|r| r.settled_ms));
    let mut bytes: Vec<u64> = real.iter().map(|r| r.total_bytes).collect();
    bytes.sort_unstable();
    Comparison {
        scene: simulated.scene.clone(),
        transport: simulated.transport,
        link: simulated.link.clone(),
        camera: simulated.camera.clone(),
        seed: simulated.seed,
        repeats: real.len(),
        virtual_bytes: simulated.total_bytes,
        real_bytes: median(&bytes).unwrap_or(0),
        differences,
    }
}

/// A figure of a case, as a table row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure<'a> {
    /// The case: scene, transport, link, camera, seed.
    pub scene: &'a str,
    /// Transport between client and server.
    pub transport: Transport,
    /// The link.
    pub link: &'a str,
    /// The camera path's name.
    pub camera: &'a str,
    /// Seed of loss and jitter.
    pub seed: u64,
    /// Number of runs in real time.
    pub repeats: usize,
    /// Bytes received until the end in virtual time.
    pub virtual_bytes: u64,
    /// Their median in real time.
    pub real_bytes: u64,
    /// The compared figure.
    #[serde(flatten)]
    pub difference: &'a Difference,
}

/// One row per case and figure.
#[must_use]
pub fn figures(compared: &[Comparison]) -> Vec<Figure<'_>> {
    let mut figures = Vec::new();
    for case in compared {
        let Comparison { scene, transport, link, camera, seed, repeats, virtual_bytes, real_bytes, .. } =
            case;
        let row = |difference| Figure {
            scene,
            transport: *transport,
            link,
            camera,
            seed: *seed,
            repeats: *repeats,
            virtual_bytes: *virtual_bytes,
            real_bytes: *real_bytes,
            difference,
        };
        figures.extend(case.differences.iter().map(row));
    }
    figures
}

/// Median of an ascending list; the lower of two.
fn median<T: Copy>(sorted: &[T]) -> Option<T> {
    sorted.get(sorted.len().saturating_sub(1) / 2).copied()
}

/// Several lines of text.
impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: {}, {}, camera {}, seed {}; bytes {} in virtual, {} in real time (median of {})",
            self.scene,
            self.transport,
            self.link,
            self.camera,
            self.seed,
            self.virtual_bytes,
            self.real_bytes,
            self.repeats
        )?;
        let ms = |ms: Option<f64>| ms.map_or("never".to_owned(), |ms| format!("{ms:.0}"));
        for d in &self.differences {
            write!(
                f,
                "\n  {:<14} virtual {:>7} ms, real {:>7} ms ({} to {})",
                d.figure,
                ms(d.virtual_ms),
                ms(d.real_ms),
                ms(d.real_least_ms),
                ms(d.real_greatest_ms)
            )?;
            if let (Some(difference), Some(share)) = (d.difference_ms, d.difference_share) {
                write!(f, ": {difference:+.0} ms, {:+.1} %", share * 100.0)?;
            }
        }
        Ok(())
    }
}
