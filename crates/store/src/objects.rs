//! Objects in a folder or in a store with a URL: `file`, `s3`, `gs`, `az`, `http` and others of `object_store`.
//!
//! Credentials, regions and endpoints come from the environment, under the names that each store's own tools use
//! (`AWS_ACCESS_KEY_ID`, `GOOGLE_SERVICE_ACCOUNT`, `AZURE_STORAGE_ACCOUNT_NAME`, …).

use std::ops::Range;
use std::path::{Path as FilePath, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use futures_util::TryStreamExt as _;
use object_store::aws::AmazonS3Builder;
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::http::HttpBuilder;
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{
    Attribute, Attributes, BackoffConfig, GetOptions, GetRange, ObjectStore, ObjectStoreExt as _,
    ObjectStoreScheme, PutOptions, RetryConfig,
};
use tokio::time::timeout;
use url::Url;

use super::error::StoreError;

/// Time that one request may take with all its retries.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(30);
/// Defaults of options that the environment may override: timeouts of an attempt and of connecting.
const DEFAULTS: [(&str, &str); 2] = [("timeout", "10s"), ("connect_timeout", "4s")];

/// A folder of objects.
#[derive(Clone, Debug)]
pub struct Objects {
    store: Arc<dyn ObjectStore>,
    root: Path,
    /// Name in messages.
    name: String,
}

/// An object in a listing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectEntry {
    /// Name, relative to the folder.
    pub name: String,
    /// Its length in bytes.
    pub bytes: u64,
    /// Changes when the object is replaced.
    pub version: String,
}

impl Objects {
    /// Whether a word is the URL of a store, and not a path.
    #[must_use]
    pub fn is_url(word: &FilePath) -> bool {
        word.to_str().and_then(|word| word.split_once("://")).is_some_and(|(scheme, _)| {
            !scheme.is_empty()
                && scheme.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.'))
        })
    }

    /// The folder of a URL. Sends no request yet.
    ///
    /// # Errors
    /// A URL that names no store, or a store that the environment does not configure.
    pub fn of_url(url: &str) -> Result<Self, StoreError> {
        // The HTTP client uses the process's default provider.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let about = |why: String| StoreError::Url { url: without_secrets(url), why };
        let parsed = Url::parse(url).map_err(|why| about(why.to_string()))?;
        let (scheme, root) = ObjectStoreScheme::parse(&parsed).map_err(|why| about(why.to_string()))?;
        // Credentials in a URL would appear in logs and process lists.
        if parsed.query().is_some() || !parsed.username().is_empty() || parsed.password().is_some() {
            return Err(about("credentials belong into the environment, not into the URL".into()));
        }
        let options = || {
            let defaults = DEFAULTS.map(|(key, value)| (key.to_owned(), value.to_owned()));
            // Skips variables that are not UTF-8.
            let text = |(key, value): (std::ffi::OsString, std::ffi::OsString)| {
                Some((key.into_string().ok()?.to_ascii_lowercase(), value.into_string().ok()?))
            };
            defaults.into_iter().chain(std::env::vars_os().filter_map(text))
        };
        let built = |why: object_store::Error| about(why.to_string());
        macro_rules! build {
            ($builder:expr) => {{
                let builder =
                    options().fold($builder.with_retry(retries()), |builder, (key, value)| {
                        match key.parse() {
                            Ok(key) => builder.with_config(key, value),
                            Err(_) => builder,
                        }
                    });
                Arc::new(builder.build().map_err(built)?)
            }};
        }
        let store: Arc<dyn ObjectStore> = match scheme {
            ObjectStoreScheme::Local => Arc::new(LocalFileSystem::new()),
            ObjectStoreScheme::AmazonS3 => build!(AmazonS3Builder::new().with_url(url)),
            ObjectStoreScheme::GoogleCloudStorage => build!(GoogleCloudStorageBuilder::new().with_url(url)),
            ObjectStoreScheme::MicrosoftAzure => build!(MicrosoftAzureBuilder::new().with_url(url)),
            ObjectStoreScheme::Http => {
                let origin = &parsed[..url::Position::BeforePath];
                build!(HttpBuilder::new().with_url(origin))
            }
            _ => return Err(about("is of no store that is known: file, s3, gs, az, http or https".into())),
        };
        Ok(Self { store, root, name: without_secrets(url).trim_end_matches('/').to_owned() })
    }

    /// A local folder.
    ///
    /// # Errors
    /// A folder that is not there.
    pub fn of_folder(folder: &FilePath) -> Result<Self, StoreError> {
        let read = |source: std::io::Error| StoreError::Read { path: folder.to_owned(), source };
        let store =
            LocalFileSystem::new_with_prefix(folder).map_err(|why| read(std::io::Error::other(why)))?;
        Ok(Self { store: Arc::new(store), root: Path::default(), name: folder.display().to_string() })
    }

    /// Any store, under a name for messages: for tests.
    #[must_use]
    pub fn of_store(store: Arc<dyn ObjectStore>, name: &str) -> Self {
        Self { store, root: Path::default(), name: name.to_owned() }
    }

    /// Name in messages.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Name of an object in messages.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        PathBuf::from(format!("{}/{name}", self.name))
    }

    fn at(&self, name: &str) -> Path {
        name.split('/').filter(|part| !part.is_empty()).fold(self.root.clone(), |path, part| path.join(part))
    }

    async fn bounded<T>(
        &self,
        name: &str,
        doing: impl Future<Output = object_store::Result<T>>,
    ) -> Result<T, StoreError> {
        let done = timeout(REQUEST_TIMEOUT, doing).await;
        let why = match done {
            Ok(Ok(value)) => return Ok(value),
            Ok(Err(object_store::Error::NotFound { .. })) => {
                return Err(StoreError::NoSuchObject { path: self.path(name) });
            }
            Ok(Err(why)) => one_line(&why),
            Err(_) => format!("the store does not answer within {} s", REQUEST_TIMEOUT.as_secs()),
        };
        Err(StoreError::Read { path: self.path(name), source: std::io::Error::other(why) })
    }

    /// Bytes of an object from `range.start` on: as many as there are up to `range.end`; with its whole length.
    ///
    /// # Errors
    /// An object that is not there, a store that does not answer, or with a length other than stated.
    pub(super) async fn range(&self, name: &str, range: Range<u64>) -> Result<(Bytes, u64), StoreError> {
        let options = GetOptions { range: Some(GetRange::Bounded(range.clone())), ..GetOptions::default() };
        let path = self.at(name);
        let read = async {
            let answer = self.store.get_opts(&path, options).await?;
            let (length, said) = (answer.meta.size, answer.range.clone());
            Ok((answer.bytes().await?, length, said))
        };
        let (bytes, length, said) = self.bounded(name, read).await?;
        let wanted = range.start..range.end.min(length);
        if said != wanted || bytes.len() as u64 != wanted.end.saturating_sub(wanted.start) {
            let why = format!("{} bytes came from {} on, of {wanted:?} asked for", bytes.len(), said.start);
            return Err(StoreError::Read { path: self.path(name), source: std::io::Error::other(why) });
        }
        Ok((bytes, length))
    }

    /// At most so many bytes from the start of an object.
    ///
    /// # Errors
    /// An object that is not there, a store that does not answer.
    pub async fn start(&self, name: &str, most: u64) -> Result<Bytes, StoreError> {
        self.range(name, 0..most).await.map(|(bytes, _)| bytes)
    }

    /// An object whole, if it has at most so many bytes.
    ///
    /// # Errors
    /// An object that is not there or longer, a store that does not answer.
    pub async fn whole(&self, name: &str, most: u64) -> Result<Bytes, StoreError> {
        let path = self.at(name);
        let read = async {
            let answer = self.store.get(&path).await?;
            let length = answer.meta.size;
            Ok((if length <= most { answer.bytes().await? } else { Bytes::new() }, length))
        };
        let (bytes, length) = self.bounded(name, read).await?;
        if bytes.len() as u64 != length {
            let why = format!("{} bytes of {length} came; at most {most} are read", bytes.len());
            return Err(StoreError::Read { path: self.path(name), source: std::io::Error::other(why) });
        }
        Ok(bytes)
    }

    /// Writes an object atomically.
    ///
    /// # Errors
    /// A store that does not accept it.
    pub async fn put(&self, name: &str, bytes: Bytes) -> Result<(), StoreError> {
        let path = self.at(name);
        let put = async { self.store.put(&path, bytes.into()).await.map(drop) };
        self.bounded(name, put).await
    }

    /// Writes an object with a content type, as far as the store keeps types: folders do not.
    ///
    /// # Errors
    /// As [`Objects::put`].
    pub async fn put_typed(
        &self,
        name: &str,
        bytes: Bytes,
        content_type: &'static str,
    ) -> Result<(), StoreError> {
        let path = self.at(name);
        let attributes = Attributes::from_iter([(Attribute::ContentType, content_type)]);
        let options = PutOptions { attributes, ..PutOptions::default() };
        let put = async {
            match self.store.put_opts(&path, bytes.clone().into(), options).await {
                Err(object_store::Error::NotImplemented { .. }) => {
                    self.store.put(&path, bytes.into()).await.map(drop)
                }
                put => put.map(drop),
            }
        };
        self.bounded(name, put).await
    }

    /// Length of an object; `None` where it is not there.
    ///
    /// # Errors
    /// A store that does not answer.
    pub async fn length(&self, name: &str) -> Result<Option<u64>, StoreError> {
        let path = self.at(name);
        match self.bounded(name, async { self.store.head(&path).await }).await {
            Ok(meta) => Ok(Some(meta.size)),
            Err(StoreError::NoSuchObject { .. }) => Ok(None),
            Err(why) => Err(why),
        }
    }

    /// The objects directly in the folder whose names end like this, in the order of their names.
    ///
    /// # Errors
    /// A store that does not answer.
    pub async fn list(&self, ending: &str) -> Result<Vec<ObjectEntry>, StoreError> {
        let read = async {
            let found = self.store.list_with_delimiter(Some(&self.root)).await?;
            Ok(found.objects)
        };
        let objects = self.bounded("", read).await?;
        let listed = |meta: object_store::ObjectMeta| {
            let name = meta.location.filename()?.to_owned();
            let version = meta.e_tag.unwrap_or_default() + &meta.last_modified.to_rfc3339();
            name.ends_with(ending).then_some(ObjectEntry { name, bytes: meta.size, version })
        };
        let mut all: Vec<ObjectEntry> = objects.into_iter().filter_map(listed).collect();
        all.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(all)
    }

    /// Downloads an object to a file atomically.
    ///
    /// # Errors
    /// An object that is not there or longer, a store that does not answer, a file that cannot be written.
    pub async fn download(&self, name: &str, file: &FilePath, most: u64) -> Result<(), StoreError> {
        let path = self.at(name);
        let answer = self.bounded(name, async { self.store.get(&path).await }).await?;
        let length = answer.meta.size;
        let read =
            |why: String| StoreError::Read { path: self.path(name), source: std::io::Error::other(why) };
        if length > most {
            return Err(read(format!("{length} bytes; at most {most} are read")));
        }
        let mut stream = answer.into_stream();
        let write = |source| StoreError::Write { path: file.to_owned(), source };
        let mut part =
            tempfile::NamedTempFile::new_in(file.parent().unwrap_or(FilePath::new("."))).map_err(write)?;
        let mut got = 0;
        while let Some(bytes) = self.bounded(name, stream.try_next()).await? {
            got += bytes.len() as u64;
            std::io::Write::write_all(&mut part, &bytes).map_err(write)?;
        }
        if got != length {
            return Err(read(format!("{got} bytes of {length} came")));
        }
        part.persist(file).map_err(|why| write(why.error))?;
        Ok(())
    }
}

/// Retries of transient faults with exponential backoff and jitter, so that servers do not retry in step (decorrelated
/// jitter: Brooker, "Exponential Backoff and Jitter", 2015).
#[must_use]
pub fn retries() -> RetryConfig {
    RetryConfig {
        backoff: BackoffConfig {
            init_backoff: Duration::from_millis(100),
            max_backoff: Duration::from_secs(5),
            base: 2.0,
        },
        max_retries: 5,
        retry_timeout: Duration::from_secs(20),
    }
}

/// A URL for logs.
fn without_secrets(url: &str) -> String {
    let Ok(mut parsed) = Url::parse(url) else { return "the URL".to_owned() };
    parsed.set_query(None);
    let _ = (parsed.set_username(""), parsed.set_password(None));
    parsed.into()
}

/// The error with its causes in one line, and what to do about a certificate.
fn one_line(error: &object_store::Error) -> String {
    let text = error.to_string();
    let mut line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let mut causes = std::iter::successors(std::error::Error::source(error), |cause| cause.source());
    let is_untrusted = |cause: &str| cause.contains("invalid peer certificate");
    if is_untrusted(&line) || causes.any(|cause| is_untrusted(&cause.to_string())) {
        line += ": the environment's SSL_CERT_FILE may name a file of the authorities to trust (PEM)";
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_are_urls_or_paths() {
        for url in ["s3://b/c", "file:///x", "https://h/x", "gs://b", "az://c/d"] {
            assert!(Objects::is_url(FilePath::new(url)), "{url}");
        }
        for path in ["a.obj", "/a/b", "C:\\x", "://", "a b://c", "scene.toml"] {
            assert!(!Objects::is_url(FilePath::new(path)), "{path}");
        }
    }

    #[test]
    fn errors_of_unknown_store_urls_hide_their_secrets() {
        let told = |url: &str| Objects::of_url(url).unwrap_err().to_string();
        assert!(told("ftp://h/x").contains("ftp://h/x"), "{}", told("ftp://h/x"));
        for url in ["s3://key:word@bucket/x", "https://h/x?sig=word"] {
            let why = told(url);
            assert!(why.contains("environment") && !why.contains("word"), "{why}");
        }
        assert!(told("s3://").contains("s3://"));
    }
}
