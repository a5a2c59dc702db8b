//! Introspection by a program, started for each request: JSON on its standard input, the response on its standard output.

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

/// Longest text from standard error in the log, in bytes.
const MAX_STDERR_BYTES: usize = 1024;

impl Hook {
    /// Introspection by a program.
    ///
    /// # Errors
    /// There is no such file. Whether it can be executed is known only at the first request.
    pub fn from_command(program: &Path) -> anyhow::Result<Self> {
        let about = || format!("--access-command {}", program.display());
        // A bare name would be searched in PATH.
        let program = std::path::absolute(program).with_context(about)?;
        let is_file = std::fs::metadata(&program).with_context(about)?.is_file();
        anyhow::ensure!(is_file, "{}: not a file; name a program", about());
        Ok(Self::new(about(), CommandBackend(program.into())))
    }
}

struct CommandBackend(Arc<Path>);

impl Introspect for CommandBackend {
    fn introspect(
        &self,
        request: IntrospectionRequest,
    ) -> BoxFuture<'static, Result<IntrospectionResponse, HookError>> {
        let program = Arc::clone(&self.0);
        Box::pin(async move { run(&program, &request).await })
    }
}

async fn run(program: &Path, request: &IntrospectionRequest) -> Result<IntrospectionResponse, HookError> {
    let failed = |why: io::Error| HookError::Spawn(why.to_string());
    let json = serde_json::to_vec(request).map_err(|why| HookError::Spawn(why.to_string()))?;
    // Neither the command line nor the environment holds the token: other processes can read both.
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
            // A program may answer without reading the request.
            let _ = input.write_all(&json).await;
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

/// Reads to the end and keeps the first `keep` bytes: a program that cannot write would not end.
async fn read(pipe: Option<impl AsyncRead + Unpin>, keep: usize) -> io::Result<Vec<u8>> {
    let mut kept = Vec::new();
    if let Some(mut pipe) = pipe {
        (&mut pipe).take(keep as u64).read_to_end(&mut kept).await?;
        tokio::io::copy(&mut pipe, &mut tokio::io::sink()).await?;
    }
    Ok(kept)
}
