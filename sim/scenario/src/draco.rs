//! Lengths of Draco files, from Draco's own encoder program.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, bail};

/// The program's name.
const PROGRAM: &str = "draco_encoder";
/// Highest compression level.
const LEVEL: &str = "10";

/// Draco's encoder program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Encoder(PathBuf);

impl Encoder {
    /// The encoder at a path.
    ///
    /// # Errors
    /// A path that is not a file.
    pub fn at(path: &Path) -> anyhow::Result<Self> {
        if !path.is_file() {
            bail!("{}: there is no such program; name Draco's {PROGRAM}", path.display());
        }
        Ok(Self(path.to_owned()))
    }

    /// The encoder in one of the folders of a search path such as `$PATH`.
    #[must_use]
    pub fn on_path(folders: &std::ffi::OsStr) -> Option<Self> {
        std::env::split_paths(folders)
            .map(|folder| folder.join(PROGRAM))
            .find(|file| file.is_file())
            .map(Self)
    }

    /// Length of the Draco file of an OBJ text: level 10, `position_bits` and `uv_bits` per axis, 8 bits for normals
    /// (Draco's default).
    ///
    /// # Errors
    /// An encoder that cannot be run or refuses the mesh.
    pub fn bytes(&self, obj: &[u8], position_bits: u8, uv_bits: u8) -> anyhow::Result<u64> {
        let folder = tempfile::tempdir().context("no folder for Draco's files")?;
        let (input, output) = (folder.path().join("in.obj"), folder.path().join("out.drc"));
        std::fs::write(&input, obj).with_context(|| format!("{}: cannot be written", input.display()))?;
        let ran = Command::new(&self.0)
            .arg("-i")
            .arg(&input)
            .arg("-o")
            .arg(&output)
            .args(["-qp", &position_bits.to_string(), "-qt", &uv_bits.to_string(), "-cl", LEVEL])
            .output()
            .with_context(|| format!("{}: cannot be run", self.0.display()))?;
        if !ran.status.success() {
            let said =
                String::from_utf8_lossy(&ran.stderr).into_owned() + &String::from_utf8_lossy(&ran.stdout);
            let said =
                said.lines().find(|line| !line.trim().is_empty()).unwrap_or("and says nothing").to_owned();
            bail!("{}: fails with {}: {said}", self.0.display(), ran.status);
        }
        let made = std::fs::metadata(&output)
            .with_context(|| format!("{}: succeeds, but writes no file", self.0.display()))?;
        Ok(made.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    fn program(folder: &Path, script: &str) -> Encoder {
        use std::os::unix::fs::PermissionsExt as _;
        let path = folder.join(PROGRAM);
        std::fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
        Encoder::on_path(folder.as_os_str()).unwrap()
    }

    #[test]
    #[cfg(unix)]
    fn the_program_is_found_and_told_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(Encoder::on_path(folder.path().as_os_str()), None);
        // Writes its arguments without the paths, then the mesh.
        let encoder = program(folder.path(), "echo \"$5 $6 $7 $8 $9 ${10}\" > \"$4\"; cat \"$2\" >> \"$4\"");
        assert_eq!(encoder, Encoder::at(&folder.path().join(PROGRAM)).unwrap());
        assert_eq!(
            encoder.bytes(b"v 0 0 0\n", 12, 9).unwrap(),
            "-qp 12 -qt 9 -cl 10\nv 0 0 0\n".len() as u64
        );
    }

    #[test]
    #[cfg(unix)]
    fn a_program_that_fails_is_quoted() {
        let folder = tempfile::tempdir().unwrap();
        let fails = program(folder.path(), "echo 'no faces' >&2; exit 3");
        let why = fails.bytes(b"", 12, 12).unwrap_err().to_string();
        assert!(why.contains("no faces") && why.contains('3'), "{why}");
        let idle = program(folder.path(), "exit 0");
        assert!(idle.bytes(b"", 12, 12).unwrap_err().to_string().contains("writes no file"));
        assert!(Encoder::at(&folder.path().join("other")).is_err());
    }
}
