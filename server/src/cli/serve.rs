//! `serve`: prepares a scene's models where needed, then streams.

use std::net::SocketAddr;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use anyhow::Context as _;
use clap::{Args, value_parser};
use lodestream_compress::whole_file::remove_stale;
use url::Url;

use super::log::Log;
use super::log_limit::{LogLimit, parse_log_limit};
use super::log_lines::LogFormat;
use super::outcome::Outcome;
use super::preparation_settings::SceneArguments;
use super::units::{Rate, parse_rate};
use crate::catalogue::Catalogue;
use lodestream_bake::prepare::{Options, cache, remove_stale_levels};
use lodestream_daemon::{
    Access, AdminPort, AdmissionSettings, Authorization, DRAIN_SECONDS, DaemonOptions, Hook, Network, Origin,
    Page, PageSetting, SessionRateLimit, SessionSettings, Tokens,
};
use lodestream_store::DEFAULT_CACHE_BYTES;

/// Longest time to drain: a day.
const MAX_DRAIN_SECONDS: u64 = 24 * 60 * 60;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Models (OBJ, glTF, GLB, PLY, STL), which are combined to one scene; or scenes: scene files (TOML), folders of scene
    /// files or models, published scenes (.lss) and folders of them, by path or URL (file, s3, gs, az, https). They are
    /// checked for changes every --scene-check seconds and at SIGHUP.
    #[arg(value_name = "MODEL … | SCENE …", required = true)]
    files: Vec<PathBuf>,
    /// Options file (TOML): keys are these flags without their dashes, and files. Flags and environment take
    /// precedence.
    #[arg(long, env = "LODESTREAM_CONFIG", value_name = "FILE")]
    config: Option<PathBuf>,
    /// Write the effective options to a file for --config, and do not serve.
    #[arg(long, value_name = "FILE")]
    pub(super) save_config: Option<PathBuf>,
    /// Rate limit of each session: 2Mbit, 500kbit, off.
    #[arg(long, env = "LODESTREAM_RATE", value_name = "RATE", default_value = "off", value_parser = parse_rate)]
    rate: Rate,
    /// Rate limit of all sessions of one address together (for IPv6 a /64 network), shared fairly. Clients behind a
    /// proxy share its address, unless --trusted-proxy names it.
    #[arg(long, env = "LODESTREAM_RATE_PER_ADDRESS", value_name = "RATE", default_value = "off", value_parser = parse_rate)]
    rate_per_address: Rate,
    /// Rate limit of all sessions together, shared fairly by the weights of their tokens.
    #[arg(long, env = "LODESTREAM_TOTAL_RATE", value_name = "RATE", default_value = "off", value_parser = parse_rate)]
    total_rate: Rate,
    /// Address for QUIC (UDP); port 0 for any free port.
    #[arg(long, env = "LODESTREAM_LISTEN", value_name = "ADDRESS", default_value = "127.0.0.1:4433")]
    listen: SocketAddr,
    /// Address for the page for browsers, WebSocket, /health, /ready and /scenes (TCP); port 0 for any free port.
    #[arg(long, env = "LODESTREAM_HTTP", value_name = "ADDRESS", default_value = "127.0.0.1:8080")]
    http: SocketAddr,
    /// Folder of the page for browsers, as script/web builds it [default: ../share/lodestream/web or ../web beside the
    /// program's folder, if it is there].
    #[arg(long, env = "LODESTREAM_PAGE", value_name = "DIR")]
    page: Option<PathBuf>,
    /// Use TLS on the HTTP port (wss:// and https://), with the same certificate as QUIC.
    #[arg(long, env = "LODESTREAM_HTTP_TLS")]
    http_tls: bool,
    /// Address for /health, /ready, /scenes and /metrics (TCP), for operators; port 0 for any free port, or off
    /// [default:
    /// 127.0.0.1:8081, or any free port of 127.0.0.1 if that is taken].
    #[arg(long, env = "LODESTREAM_ADMIN", value_name = "ADDRESS")]
    admin: Option<AdminPort>,
    /// Interval of checks for changed scenes in seconds; 0: only at SIGHUP. New sessions get the new version; running
    /// sessions keep theirs.
    #[arg(long, env = "LODESTREAM_SCENE_CHECK", value_name = "SECONDS", default_value_t = 10,
        value_parser = value_parser!(u64).range(..=MAX_DRAIN_SECONDS))]
    scene_check: u64,
    /// Memory for the blobs of all scenes, in MiB, at least 1.
    #[arg(long, env = "LODESTREAM_BLOB_CACHE", value_name = "MIB", default_value_t = DEFAULT_CACHE_BYTES >> 20,
        value_parser = value_parser!(u64).range(1..=1 << 20))]
    blob_cache: u64,
    /// Folder of prepared packs [default: $XDG_CACHE_HOME/lodestream or ~/.cache/lodestream].
    #[arg(long, env = "LODESTREAM_CACHE", value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Most sessions at once, at least 1. An eighth is reserved for addresses without a session.
    #[arg(long, env = "LODESTREAM_MAX_SESSIONS", value_name = "N", default_value_t = 1000,
        value_parser = value_parser!(u64).range(1..))]
    max_sessions: u64,
    /// Most sessions of one address at once (for IPv6 a /64 network), at least 1 [default: an eighth of --max-sessions,
    /// at least 8]. Clients behind a proxy share its address, unless --trusted-proxy names it.
    #[arg(long, env = "LODESTREAM_MAX_SESSIONS_PER_ADDRESS", value_name = "N",
        value_parser = value_parser!(u64).range(1..))]
    max_sessions_per_address: Option<u64>,
    /// Most sessions that one address may start at once, at least 1, or off; an eighth of it is refilled each second
    /// [default: as --max-sessions-per-address, at least 32].
    #[arg(long, env = "LODESTREAM_NEW_SESSIONS_PER_ADDRESS", value_name = "N")]
    new_sessions_per_address: Option<SessionRateLimit>,
    /// Time for running sessions to finish after SIGTERM or SIGINT, in seconds. New sessions are refused, idle ones
    /// closed
    /// at once. A second signal ends the server at once.
    #[arg(long, env = "LODESTREAM_DRAIN", value_name = "SECONDS", default_value_t = DRAIN_SECONDS,
        value_parser = value_parser!(u64).range(..=MAX_DRAIN_SECONDS))]
    drain: u64,
    /// Origins of web pages that may open sessions (https://example.org), separated by commas; * for any. The server's
    /// own page needs no entry if it is opened by IP address, as localhost, by a name without dots, or over https. Other
    /// programs send no origin and are always allowed.
    #[arg(long, env = "LODESTREAM_ALLOW_ORIGIN", value_name = "ORIGIN", value_delimiter = ',')]
    allow_origin: Vec<Origin>,
    /// Trusted proxies before the HTTP port: the client's address is taken from their X-Forwarded-For header. Addresses
    /// or
    /// networks (10.0.0.0/8), separated by commas.
    #[arg(long, env = "LODESTREAM_TRUSTED_PROXY", value_name = "CIDR", value_delimiter = ',')]
    trusted_proxy: Vec<Network>,
    /// Require tokens (JSON Web Tokens) signed by a key of this file: a public key (PEM), a key set (JWKS), or a secret
    /// of at
    /// least 32 bytes. Read again when it changes and at SIGHUP.
    #[arg(long, env = "LODESTREAM_TOKEN_KEYS", value_name = "FILE", group = "access")]
    token_keys: Option<PathBuf>,
    /// Audience that tokens must name; without this flag, tokens with an audience are refused.
    #[arg(long, env = "LODESTREAM_TOKEN_AUDIENCE", value_name = "NAME", requires = "token_keys")]
    token_audience: Option<String>,
    /// Require tokens that this program accepts: it reads one line of JSON (token, scene, client_address) and answers
    /// with
    /// JSON (active: true or false; exp, scene, weight, rate, sub as in a token).
    #[arg(long, env = "LODESTREAM_ACCESS_COMMAND", value_name = "FILE", group = "access")]
    access_command: Option<PathBuf>,
    /// Require tokens that this URL accepts (http or https), by token introspection (RFC 7662).
    #[arg(long, env = "LODESTREAM_ACCESS_URL", value_name = "URL", group = "access")]
    access_url: Option<Url>,
    /// File with the value of the Authorization header for --access-url, for example "Bearer SECRET". Read again when
    /// it
    /// changes and at SIGHUP.
    #[arg(long, env = "LODESTREAM_ACCESS_AUTHORIZATION", value_name = "FILE", requires = "access_url")]
    access_authorization: Option<PathBuf>,
    /// Certificate chain (PEM), read again when it changes and at SIGHUP [default: a self-signed certificate, kept in
    /// the
    /// cache folder].
    #[arg(long, env = "LODESTREAM_CERT", value_name = "FILE", requires = "key")]
    cert: Option<PathBuf>,
    /// Private key (PEM) of the certificate.
    #[arg(long, env = "LODESTREAM_KEY", value_name = "FILE", requires = "cert")]
    key: Option<PathBuf>,
    /// Format of the log on standard error: text, or json with one object per line.
    #[arg(long, env = "LODESTREAM_LOG_FORMAT", value_name = "FORMAT", value_enum, default_value_t = LogFormat::Text)]
    log_format: LogFormat,
    /// Most log lines per second from one place in the code, or off; later lines are counted.
    #[arg(long, env = "LODESTREAM_LOG_LIMIT", value_name = "LINES", default_value = "100", value_parser = parse_log_limit)]
    log_limit: LogLimit,
    #[command(flatten)]
    preparation_settings: SceneArguments,
    /// Threads for preparation [default: one per core].
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
}

impl Arguments {
    /// The settings that a reload may change. Keys and other sources of access are reloaded elsewhere.
    fn changeable(&self) -> (SessionSettings, AdmissionSettings) {
        let sessions = SessionSettings {
            rate_bits_per_s: self.rate.0,
            rate_per_address_bits_per_s: self.rate_per_address.0,
            total_rate_bits_per_s: self.total_rate.0,
            max_sessions: self.max_sessions,
            max_sessions_per_address: self.max_sessions_per_address,
            new_sessions_per_address: self.new_sessions_per_address,
            drain: Duration::from_secs(self.drain),
        };
        let admission = AdmissionSettings {
            origins: self.allow_origin.iter().cloned().collect(),
            proxies: self.trusted_proxy.iter().copied().collect(),
            access: None,
        };
        (sessions, admission)
    }

    /// How tokens are verified; `None` if none are required.
    fn access(&self) -> anyhow::Result<Option<Access>> {
        if let Some(file) = &self.token_keys {
            return Tokens::from_file(file, self.token_audience.clone()).map(Access::Tokens).map(Some);
        }
        if let Some(program) = &self.access_command {
            let hook = Hook::from_command(program)?;
            return Ok(Some(Access::Hook { hook, authorization: None }));
        }
        let Some(url) = &self.access_url else { return Ok(None) };
        let authorization = self.access_authorization.as_deref().map(Authorization::from_file).transpose()?;
        let hook = Hook::from_url(url, authorization.clone())?;
        Ok(Some(Access::Hook { hook, authorization }))
    }
}

/// The page of `folder`, or else of the folder where the package or the build puts it.
fn page(folder: Option<&Path>) -> anyhow::Result<PageSetting> {
    if let Some(folder) = folder {
        return Ok(PageSetting::Loaded(Page::load(folder).context("--page")?));
    }
    PageSetting::installed().context("the page for browsers")
}

/// Prepares, opens and serves the scenes. `again` parses the arguments again, with the file's present contents.
pub(super) fn run(
    arguments: Arguments,
    again: impl Fn() -> anyhow::Result<Arguments> + Send + Sync + 'static,
) -> anyhow::Result<Outcome> {
    let (sessions, admission) = arguments.changeable();
    let access = arguments.access()?;
    let page = page(arguments.page.as_deref())?;
    let cache = match arguments.cache.or_else(cache::default_folder) {
        Some(folder) => folder,
        None => anyhow::bail!("no cache folder is known; name one with --cache DIR"),
    };
    let options = Options {
        preparation_settings: arguments.preparation_settings.resolve(),
        threads: arguments.threads,
        quiet: false,
        keep_levels: false,
        watch: None,
    };
    remove_stale(&cache, SystemTime::now());
    remove_stale_levels(&cache, SystemTime::now());
    let look_every = (arguments.scene_check > 0).then(|| Duration::from_secs(arguments.scene_check));
    let cache_bytes = arguments.blob_cache << 20;
    let catalogue = Catalogue::new(&arguments.files, cache.clone(), options, cache_bytes, look_every)?;
    let catalogue = Arc::new(catalogue);
    let runtime = tokio::runtime::Runtime::new().context("cannot start the network threads")?;
    let scenes = runtime.block_on(catalogue.open())?;
    let log = Log::to_stderr(arguments.log_format, arguments.log_limit);
    let daemon = DaemonOptions {
        listen: Some(arguments.listen),
        http: Some(arguments.http),
        http_tls: arguments.http_tls,
        page,
        admin: arguments.admin.unwrap_or(AdminPort::Standard),
        certificate: arguments.cert.zip(arguments.key),
        admission: AdmissionSettings { access: access.map(Arc::new), ..admission },
        sessions,
        settings_reload: Some(Arc::new(move || again().map(|arguments| arguments.changeable()))),
        provider: Some(catalogue),
        dropped_log_lines: Some(log.dropped_lines()),
        ..DaemonOptions::new(cache)
    };
    runtime.block_on(lodestream_daemon::run(daemon, scenes))?;
    Ok(Outcome::good(""))
}
