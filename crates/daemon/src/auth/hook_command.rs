//! A program that is run for each question, which it reads as JSON from its standard input and answers on its standard
//! output.

use std::io;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;

use anyhow::Context as _;
use futures_util::future::BoxFuture;
use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWriteExt as _};
use tokio::process::Command;

use crate::auth::hook::{
    Hook, HookError, Introspect, IntrospectionRequest, IntrospectionResponse, MAX_RESPONSE_BYTES, one_line,
};

/// What is kept of what a program says beside its answer, in bytes.
const MAX_STDERR_BYTES: usize = 1024;

impl Hook {
    /// Runs a program.
    ///
    /// # Errors
    /// Fails where there is no such file. Whether it can be run shows when it is.
    pub fn from_command(program: &Path) -> anyhow::Result<Self> {
        let about = || format!("--access-command {}", program.display());
        // A bare name would be looked for elsewhere than where it was found.
        let program = std::path::absolute(program).with_context(about)?;
        let is_file = std::fs::metadata(&program).with_context(about)?.is_file();
        anyhow::ensure!(is_file, "{}: it is no file; name a program", about());
        Ok(Self::new(about(), RunCommand(program.into())))
    }
}

struct RunCommand(Arc<Path>);

impl Introspect for RunCommand {
    fn introspect(
        &self,
        question: IntrospectionRequest,
    ) -> BoxFuture<'static, Result<IntrospectionResponse, HookError>> {
        let program = Arc::clone(&self.0);
        Box::pin(async move { run(&program, &question).await })
    }
}

async fn run(program: &Path, question: &IntrospectionRequest) -> Result<IntrospectionResponse, HookError> {
    let failed = |why: io::Error| HookError::Spawn(why.to_string());
    let request = serde_json::to_vec(question).map_err(|why| HookError::Spawn(why.to_string()))?;
    // The token is in no list of processes: neither a word of the command line nor a variable.
    let mut child = Command::new(PathBuf::from(program))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .kill_on_drop(true)
        .spawn()
        .map_err(failed)?;
    let (input, output, stderr) = (child.stdin.take(), child.stdout.take(), child.stderr.take());
    let write = async {
        if let Some(mut input) = input {
            // A program that answers without reading is none the worse for it.
            let _ = input.write_all(&request).await;
            let _ = input.write_all(b"\n").await;
        }
    };
    let ((), answer, stderr) =
        tokio::join!(write, read(output, MAX_RESPONSE_BYTES + 1), read(stderr, MAX_STDERR_BYTES));
    let answer = answer.map_err(failed)?;
    if answer.len() > MAX_RESPONSE_BYTES {
        return Err(HookError::TooLong);
    }
    let status = child.wait().await.map_err(failed)?;
    if !status.success() {
        let stderr = one_line(&stderr.unwrap_or_default());
        let stderr = if stderr.is_empty() { stderr } else { format!(": {stderr}") };
        return Err(HookError::ExitStatus { status: status.to_string(), stderr });
    }
    IntrospectionResponse::parse(&answer)
}

/// Reads to the end and keeps this many bytes of it: who cannot write would not end.
async fn read(pipe: Option<impl AsyncRead + Unpin>, keep: usize) -> io::Result<Vec<u8>> {
    let mut kept = Vec::new();
    if let Some(mut pipe) = pipe {
        (&mut pipe).take(keep as u64).read_to_end(&mut kept).await?;
        tokio::io::copy(&mut pipe, &mut tokio::io::sink()).await?;
    }
    Ok(kept)
}
