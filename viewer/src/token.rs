//! The token that shows who may see the scene: from a file, which is read again when it changes, or from the environment.
//! A command line is no place for it: everybody on the machine can read that.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, bail};
use lodestream_client::streaming::Streaming;
use lodestream_protocol::message::Token;
use lodestream_scene::limits::MAX_TOKEN_BYTES;

/// Where it is if no file is named.
pub(crate) const VARIABLE: &str = "LODESTREAM_TOKEN";
/// Time between two looks at the file.
const LOOK_EVERY: Duration = Duration::from_secs(5);

/// The token of a file, else of the environment, if either is there.
///
/// # Errors
/// Fails where the file cannot be read, or what there is can be no token.
pub(crate) fn find(file: Option<&Path>) -> anyhow::Result<Option<Token>> {
    match file {
        Some(file) => read(file).with_context(|| format!("--token-file {}", file.display())).map(Some),
        None => match std::env::var(VARIABLE) {
            Ok(text) if !text.trim().is_empty() => checked(&text).context(VARIABLE).map(Some),
            _ => Ok(None),
        },
    }
}

fn read(file: &Path) -> anyhow::Result<Token> {
    if std::fs::metadata(file)?.len() > MAX_TOKEN_BYTES as u64 + 2 {
        bail!("it is longer than a token may be, {MAX_TOKEN_BYTES} bytes");
    }
    checked(&std::fs::read_to_string(file)?)
}

fn checked(text: &str) -> anyhow::Result<Token> {
    let text = text.trim();
    if text.is_empty() || text.len() > MAX_TOKEN_BYTES {
        bail!("a token has 1 to {MAX_TOKEN_BYTES} characters, this has {}", text.len());
    }
    if !text.bytes().all(|byte| byte.is_ascii_graphic()) {
        bail!("a token has no spaces, and no characters beyond ASCII");
    }
    Ok(Token(text.to_owned()))
}

/// Shows the server what the file holds whenever that changes, as long as the session lasts.
///
/// # Errors
/// Fails where the system gives no thread.
pub(crate) fn follow(file: Option<&PathBuf>, streaming: &Streaming) -> std::io::Result<()> {
    let Some(file) = file.cloned() else { return Ok(()) };
    let tokens = streaming.tokens();
    std::thread::Builder::new().name("token".into()).spawn(move || {
        while !tokens.is_closed() {
            // A file that is being replaced may be away for a moment.
            if let Ok(token) = read(&file) {
                tokens.show(token);
            }
            std::thread::sleep(LOOK_EVERY);
        }
    })?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_are_read_without_the_line_end() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("token");
        std::fs::write(&file, "a.b.c\n").unwrap();
        assert_eq!(find(Some(&file)).unwrap(), Some(Token("a.b.c".into())));
        for bad in ["", "\n", "a b", "ä", &"x".repeat(MAX_TOKEN_BYTES + 1)] {
            std::fs::write(&file, bad).unwrap();
            let why = format!("{:#}", find(Some(&file)).unwrap_err());
            assert!(why.contains("--token-file") && !why.contains("xxx"), "{why}");
        }
        assert!(find(Some(&folder.path().join("none"))).is_err());
    }
}
