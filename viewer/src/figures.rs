//! The table of statistics that `--figures` prints.

use std::fmt::{self, Display, Formatter};

use crate::report::Report;

/// Displays a report as a table of times and bytes.
pub(crate) struct StatisticsTable<'a>(pub(crate) &'a Report);

impl Display for StatisticsTable<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let report = self.0;
        let one_px = "1".to_owned();
        let link = report.rate_bits_per_s.map_or_else(
            || format!("over {}", report.transport),
            |rate| {
                // A rate to three digits.
                let megabits = rate as f64 / 1e6;
                format!("over {}, limited to {megabits} Mbit/s", report.transport)
            },
        );
        let settled = report.settled_ms.map(|_| report.total_bytes);
        row(f, &link, "time", "bytes")?;
        let rows = [
            ("first frame: everything in view as base mesh", report.ttff_ms, report.first_frame_bytes),
            ("first frame on the screen or in the file", report.ttff_presented_ms, None),
            (
                "screen error of 1 pixel or less where it is seen",
                report.unoccluded_ttq_ms.get(&one_px).copied().flatten(),
                report.unoccluded_ttq_bytes.get(&one_px).copied().flatten(),
            ),
            (
                "screen error of 1 pixel or less everywhere",
                report.ttq_ms.get(&one_px).copied().flatten(),
                report.ttq_bytes.get(&one_px).copied().flatten(),
            ),
            ("settled, textures included", report.settled_ms, settled),
        ];
        for (name, ms, bytes) in rows {
            row(f, name, &seconds(ms), &bytes.map(size).unwrap_or_default())?;
        }
        Ok(())
    }
}

fn row(f: &mut Formatter<'_>, name: &str, time: &str, size: &str) -> fmt::Result {
    writeln!(f, "{}", format!("{name:<52} {time:>14} {size:>12}").trim_end())
}

fn seconds(ms: Option<f64>) -> String {
    ms.map_or_else(|| "not reached".to_owned(), |ms| format!("{:.2} s", ms / 1e3))
}

fn size(bytes: u64) -> String {
    // To three digits.
    let bytes = bytes as f64;
    if bytes < 1e6 { format!("{:.1} kB", bytes / 1e3) } else { format!("{:.2} MB", bytes / 1e6) }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use lodestream_client::core::{Milestone, Milestones, Stats};

    use super::*;
    use crate::frames::FrameLog;

    #[test]
    fn milestones_have_times_and_bytes_or_are_not_reached() {
        let at = |ms, bytes| Some(Milestone { after: Duration::from_millis(ms), bytes });
        let mut stats = Stats {
            rate_bits_per_s: Some(2_000_000),
            transport_bytes: 1_234_567,
            milestones: Milestones {
                first_frame: at(178, 20_400),
                quality: [at(300, 2000), None, None],
                unoccluded_quality: [at(300, 2000), at(400, 3000), at(1980, 500_000)],
            },
            ..Stats::default()
        };
        let mut shown = FrameLog::default();
        shown.note(Duration::from_millis(1570), true, &Default::default(), Default::default());
        let report = Report::new(&stats, "quic", &shown);
        let expected = "\
over quic, limited to 2 Mbit/s                                 time        bytes
first frame: everything in view as base mesh                 0.18 s      20.4 kB
first frame on the screen or in the file                     1.57 s
screen error of 1 pixel or less where it is seen             1.98 s     500.0 kB
screen error of 1 pixel or less everywhere              not reached
settled, textures included                              not reached
";
        assert_eq!(StatisticsTable(&report).to_string(), expected);
        stats.milestones.quality[2] = at(2220, 558_000);
        stats.settled_after = Some(Duration::from_millis(3550));
        let report = Report::new(&stats, "quic", &FrameLog::default());
        let table = StatisticsTable(&report).to_string();
        assert!(table.contains("2.22 s     558.0 kB") && table.contains("3.55 s      1.23 MB"), "{table}");
    }
}
