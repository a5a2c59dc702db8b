//! Camera paths of a plan: `[camera.NAME]`.

use serde::Deserialize;

use super::Fault;
use crate::camera_path::{CameraPath, Motion, Start};

/// Longest path, in seconds.
const MAX_SECONDS: f64 = 86_400.0;

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraFile {
    path: Kind,
    seconds: Option<f64>,
    degrees: Option<f64>,
    distance: Option<f64>,
    times: Option<f64>,
    starts: Option<StartFile>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Kind {
    Still,
    Orbit,
    FlyThrough,
    Teleport,
    Swing,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "expected \"first-frame\", \"settled\", or seconds since the connect call")]
enum StartFile {
    Seconds(f64),
    When(When),
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum When {
    FirstFrame,
    Settled,
}

/// The predefined path of a name, for names without a table in the plan.
pub(super) fn by_name(name: &str) -> Option<CameraPath> {
    let path = match name {
        "still" => Kind::Still,
        "orbit" => Kind::Orbit,
        "fly-through" => Kind::FlyThrough,
        "teleport" => Kind::Teleport,
        "swing" => Kind::Swing,
        _ => return None,
    };
    let file = CameraFile { path, seconds: None, degrees: None, distance: None, times: None, starts: None };
    file.check().ok()
}

impl CameraFile {
    pub(super) fn check(&self) -> Result<CameraPath, Fault> {
        let number = |field: &str, value: Option<f64>, default: f64, most: f64| match value {
            None => Ok(default),
            Some(value) if value.abs() <= most && value != 0.0 => Ok(value),
            Some(value) => {
                Err(Fault::new(field, format!("{value} is not a number up to {most} other than 0")))
            }
        };
        let degrees = |default: f64| number("degrees", self.degrees, default, 36_000.0);
        let motion = match self.path {
            Kind::Still => Motion::Still,
            Kind::Orbit => Motion::Orbit { degrees: degrees(360.0)? },
            Kind::FlyThrough => Motion::FlyThrough { distance: number("distance", self.distance, 1.5, 1e6)? },
            Kind::Teleport => Motion::Teleport { degrees: degrees(180.0)? },
            Kind::Swing => {
                Motion::Swing { degrees: degrees(45.0)?, times: number("times", self.times, 2.0, 1e4)?.abs() }
            }
        };
        let moves = !matches!(self.path, Kind::Still | Kind::Teleport);
        let turns = matches!(self.path, Kind::Orbit | Kind::Teleport | Kind::Swing);
        let unused = [
            ("seconds", self.seconds.is_some() && !moves),
            ("degrees", self.degrees.is_some() && !turns),
            ("distance", self.distance.is_some() && self.path != Kind::FlyThrough),
            ("times", self.times.is_some() && self.path != Kind::Swing),
            ("starts", self.starts.is_some() && self.path == Kind::Still),
        ];
        if let Some((field, _)) = unused.iter().find(|(_, unused)| *unused) {
            return Err(Fault::new(*field, "means nothing for this path; leave it out".to_owned()));
        }
        let seconds = if moves { number("seconds", self.seconds, 12.0, MAX_SECONDS)? } else { 0.0 };
        if seconds < 0.0 {
            return Err(Fault::new("seconds", format!("{seconds} is not a duration")));
        }
        let start = match self.starts {
            None if self.path == Kind::Teleport => Start::Settled,
            None | Some(StartFile::When(When::FirstFrame)) => Start::FirstFrame,
            Some(StartFile::When(When::Settled)) => Start::Settled,
            Some(StartFile::Seconds(at)) if (0.0..=1e6).contains(&at) => Start::At { seconds: at },
            Some(StartFile::Seconds(at)) => {
                return Err(Fault::new("starts", format!("{at} is not a time from 0 to 1e6 seconds")));
            }
        };
        Ok(CameraPath { motion, seconds, start })
    }
}
