//! Introspection by a URL (RFC 7662, section 2).

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};

use anyhow::Context as _;
use futures_util::future::BoxFuture;
use reqwest::header::{ACCEPT, AUTHORIZATION, CONTENT_TYPE, HeaderValue};
use reqwest::redirect::Policy;
use reqwest::{Client, Response};
use tokio::sync::watch;
use url::Url;
use url::form_urlencoded::Serializer;

use crate::auth::hook::{
    Hook, HookError, Introspect, IntrospectionRequest, IntrospectionResponse, MAX_RESPONSE_BYTES,
};
use crate::lifecycle::file_watch::{read_small_file, watch_files};

/// The server's credentials for the URL: the value of the header `Authorization`, from a file.
#[derive(Clone)]
pub struct Authorization {
    file: PathBuf,
    value: Arc<RwLock<HeaderValue>>,
}

impl fmt::Debug for Authorization {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Authorization").field("file", &self.file).finish_non_exhaustive()
    }
}

impl Authorization {
    /// Reads the value without trailing white space.
    ///
    /// # Errors
    /// The file cannot be read, or holds no valid value.
    pub fn from_file(file: &Path) -> anyhow::Result<Self> {
        let value = Self::parse(&read_small_file(file)?).with_context(|| file.display().to_string())?;
        Ok(Self { file: file.to_owned(), value: Arc::new(RwLock::new(value)) })
    }

    fn parse(text: &[u8]) -> anyhow::Result<HeaderValue> {
        let text = text.trim_ascii_end();
        let scheme = text.split(|byte| *byte == b' ').next().unwrap_or_default();
        anyhow::ensure!(
            scheme.len() < text.len() && !scheme.is_empty(),
            "not a value of the header Authorization: write \"Bearer SECRET\" or \"Basic BASE64\""
        );
        let mut value =
            HeaderValue::from_bytes(text).context("it has characters that a header cannot hold")?;
        value.set_sensitive(true);
        Ok(value)
    }

    fn value(&self) -> HeaderValue {
        self.value.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Reloads the value when its file changes; never returns.
    pub(crate) async fn watch_files(self, reload_requests: watch::Receiver<u64>) {
        watch_files(
            "the authorization of the access URL",
            vec![self.file.clone()],
            reload_requests,
            |texts, first| match texts.and_then(|texts| Self::parse(&texts.concat())) {
                Ok(value) => {
                    *self.value.write().unwrap_or_else(PoisonError::into_inner) = value;
                    if !first {
                        tracing::info!("the authorization of the access URL was reloaded");
                    }
                }
                Err(why) => tracing::error!("the authorization of the access URL is not reloaded: {why:#}"),
            },
        )
        .await;
    }
}

impl Hook {
    /// Introspection by a URL, with the server's credentials.
    ///
    /// # Errors
    /// Not an http or https URL, or one with a user name or password.
    pub fn from_url(url: &Url, authorization: Option<Authorization>) -> anyhow::Result<Self> {
        anyhow::ensure!(
            matches!(url.scheme(), "http" | "https") && url.has_host(),
            "--access-url {url}: not an http or https URL"
        );
        anyhow::ensure!(
            url.username().is_empty() && url.password().is_none(),
            "--access-url: credentials in a URL would be logged and listed with the process: use --access-authorization FILE"
        );
        // The client uses the process's default provider; it may be installed already.
        let _ = rustls::crypto::ring::default_provider().install_default();
        // A redirect would take the token elsewhere.
        let client = Client::builder().redirect(Policy::none()).build();
        let client = client.context("cannot create the HTTP client for --access-url")?;
        // The query may hold a secret.
        let name = format!("--access-url {}", &url[..url::Position::AfterPath]);
        Ok(Self::new(name, UrlBackend { url: url.clone(), client, authorization }))
    }
}

struct UrlBackend {
    url: Url,
    client: Client,
    authorization: Option<Authorization>,
}

impl Introspect for UrlBackend {
    fn introspect(
        &self,
        query: IntrospectionRequest,
    ) -> BoxFuture<'static, Result<IntrospectionResponse, HookError>> {
        let mut form = Serializer::new(String::new());
        form.append_pair("token", &query.token);
        if let Some(scene) = &query.scene {
            form.append_pair("scene", scene);
        }
        form.append_pair("client_address", &query.address.to_string());
        let mut request = self
            .client
            .post(self.url.clone())
            .header(CONTENT_TYPE, "application/x-www-form-urlencoded")
            .header(ACCEPT, "application/json")
            .body(form.finish());
        if let Some(authorization) = &self.authorization {
            request = request.header(AUTHORIZATION, authorization.value());
        }
        Box::pin(async move {
            let failed = |why: reqwest::Error| HookError::Request(causes(&why.without_url()));
            let response = request.send().await.map_err(failed)?;
            if response.status() != reqwest::StatusCode::OK {
                return Err(HookError::HttpStatus(response.status().as_u16()));
            }
            IntrospectionResponse::parse(&body(response, failed).await?)
        })
    }
}

/// Reads the body of a response of bounded length.
async fn body(
    mut response: Response,
    failed: impl Fn(reqwest::Error) -> HookError,
) -> Result<Vec<u8>, HookError> {
    let mut body = Vec::new();
    while let Some(chunk) = response.chunk().await.map_err(&failed)? {
        if body.len() + chunk.len() > MAX_RESPONSE_BYTES {
            return Err(HookError::TooLong);
        }
        body.extend_from_slice(&chunk);
    }
    Ok(body)
}

/// An error's text with its causes, which the library's text omits.
fn causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut next = error.source();
    while let Some(cause) = next {
        text = format!("{text}: {cause}");
        next = cause.source();
    }
    text
}
