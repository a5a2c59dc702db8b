//! The access token: from a file, which is read again when it changes, or from the environment. It is not a command
//! line argument, because all users of the machine can read those.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, bail};
use lodestream_client::streaming::Streaming;
use lodestream_protocol::message::Token;
use lodestream_scene::limits::MAX_TOKEN_BYTES;

/// Environment variable that holds the token if there is no file.
pub(crate) const VARIABLE: &str = "LODESTREAM_TOKEN";
/// Interval at which the file is read again.
const POLL_INTERVAL: Duration = Duration::from_secs(5);

/// Loads the token from a file, else from the environment.
///
/// # Errors
/// The file cannot be read, or the text is not a valid token.
pub(crate) fn load(file: Option<&Path>) -> anyhow::Result<Option<Token>> {
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
        bail!("it is longer than the {MAX_TOKEN_BYTES} bytes allowed for a token");
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

/// Watches the file on a thread and passes new tokens to the session until streaming ends.
///
/// # Errors
/// The system provides no thread.
pub(crate) fn follow(file: Option<&PathBuf>, streaming: &Streaming) -> std::io::Result<()> {
    let Some(file) = file.cloned() else { return Ok(()) };
    let tokens = streaming.tokens();
    std::thread::Builder::new().name("token".into()).spawn(move || {
        while !tokens.is_closed() {
            // A file that is being replaced may be missing for a moment.
            if let Ok(token) = read(&file) {
                tokens.set(token);
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    })?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_are_trimmed_and_checked() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("token");
        std::fs::write(&file, "a.b.c\n").unwrap();
        assert_eq!(load(Some(&file)).unwrap(), Some(Token("a.b.c".into())));
        for bad in ["", "\n", "a b", "ä", &"x".repeat(MAX_TOKEN_BYTES + 1)] {
            std::fs::write(&file, bad).unwrap();
            let why = format!("{:#}", load(Some(&file)).unwrap_err());
            assert!(why.contains("--token-file") && !why.contains("xxx"), "{why}");
        }
        assert!(load(Some(&folder.path().join("none"))).is_err());
    }
}
