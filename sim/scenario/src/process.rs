//! Memory and processor time of a process, from Linux's `/proc`.

use std::path::{Path, PathBuf};

use anyhow::Context as _;

/// Clock ticks per second in `/proc`, on every Linux (`USER_HZ`).
const TICKS_PER_S: f64 = 100.0;

/// A running process.
#[derive(Clone, Debug)]
pub(crate) struct Process {
    folder: PathBuf,
}

impl Process {
    pub(crate) fn of(id: u32) -> Self {
        Self { folder: Path::new("/proc").join(id.to_string()) }
    }

    /// This process.
    pub(crate) fn own() -> Self {
        Self::of(std::process::id())
    }

    /// Resident memory in bytes.
    pub(crate) fn memory_bytes(&self) -> anyhow::Result<u64> {
        let (file, text) = self.read("status")?;
        let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let kib = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
        Ok(kib.with_context(|| format!("{file}: there is no VmRSS"))? * 1024)
    }

    /// Processor time so far, in seconds.
    pub(crate) fn cpu_s(&self) -> anyhow::Result<f64> {
        let (file, text) = self.read("stat")?;
        // The program's name is in parentheses and may contain anything; utime and stime are fields 14 and 15.
        let fields = text.rsplit(')').next().unwrap_or_default().split_whitespace().skip(11).take(2);
        let ticks = fields.map(|field| field.parse::<f64>().ok()).collect::<Option<Vec<f64>>>();
        let ticks =
            ticks.filter(|ticks| ticks.len() == 2).with_context(|| format!("{file}: is not understood"))?;
        Ok(ticks.iter().sum::<f64>() / TICKS_PER_S)
    }

    /// Voluntary context switches of its threads so far: how often they waited and were woken.
    pub(crate) fn wake_ups(&self) -> anyhow::Result<u64> {
        let file = self.folder.join("task");
        let threads =
            std::fs::read_dir(&file).with_context(|| format!("{}: this needs Linux", file.display()))?;
        // A thread that ended meanwhile is not counted.
        let of = |thread: std::fs::DirEntry| {
            let text = std::fs::read_to_string(thread.path().join("status")).ok()?;
            let line = text.lines().find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"))?;
            line.trim().parse::<u64>().ok()
        };
        Ok(threads.flatten().filter_map(of).sum())
    }

    fn read(&self, name: &str) -> anyhow::Result<(String, String)> {
        let file = self.folder.join(name);
        let text = std::fs::read_to_string(&file)
            .with_context(|| format!("{}: this needs Linux", file.display()))?;
        Ok((file.display().to_string(), text))
    }
}
