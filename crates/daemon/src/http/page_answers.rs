//! Answers to requests for the page: compression, caching, and the headers that confine it.

use bytes::Bytes;
use http_body_util::Full;
use hyper::header::{self, HeaderMap, HeaderName, HeaderValue};
use hyper::{Response, StatusCode};
use lodestream_protocol::stream::path_of_scene;
use serde_json::{Value, json};

use crate::http::origin::host;
use crate::http::page::{Asset, Coding, Page, PageSetting, entity_tag};
use crate::http::previews;
use crate::http::responses::{TextResponse, text};
use crate::http::site::Site;
use crate::session::scene_preview::PreviewFile;
use crate::session::state::ServerState;

/// Of files that are named by content.
const IMMUTABLE: &str = "public, max-age=31536000, immutable";

impl Site {
    /// The file for a path, if it is one of the page's.
    pub(crate) fn file(&self, state: &ServerState, path: &str, headers: &HeaderMap) -> Option<TextResponse> {
        let PageSetting::Loaded(page) = &self.page else { return None };
        let mut response = match page.asset(path) {
            Some(file) => asset(file, headers),
            None if state.admission().access.is_none() => {
                preview_file(previews::named(state.scenes(), path.strip_prefix('/')?)?.as_ref(), headers)
            }
            None => return None,
        };
        self.confine(&mut response, headers);
        Some(response)
    }

    /// The page itself, for a scene or for the only one; `None` if there is no page and none was looked for.
    pub(crate) async fn index(
        &self,
        state: &ServerState,
        scene: Option<&str>,
        headers: &HeaderMap,
    ) -> Option<TextResponse> {
        let page = match &self.page {
            PageSetting::Loaded(page) => page,
            absent => return Some(text(StatusCode::NOT_FOUND, absent.absence()? + "\n")),
        };
        // If tokens are required, a client without one must not see the scene.
        let version = scene.map_or_else(|| state.scenes().only(), |name| state.scenes().get(name));
        let version = version.filter(|_| state.admission().access.is_none());
        let preview = match version {
            Some(version) => previews::preview(version).await,
            None => None,
        };
        let mut response = self.loaded_index(page, state, scene, preview.as_deref(), headers);
        self.confine(&mut response, headers);
        Some(response)
    }

    fn loaded_index(
        &self,
        page: &Page,
        state: &ServerState,
        scene: Option<&str>,
        preview: Option<&PreviewFile>,
        headers: &HeaderMap,
    ) -> TextResponse {
        let preview = preview.map(|preview| preview.name.as_str());
        let body: Bytes = page.index(&self.description(state, scene, preview), preview).into();
        let tag = entity_tag(&body);
        let mut response = if matches_tag(headers, &tag) { not_modified() } else { whole(body) };
        let set = response.headers_mut();
        set.insert(header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8"));
        set.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
        set.insert(header::ETAG, tag);
        response
    }

    /// What the page must know, so that it needs no other request.
    fn description(&self, state: &ServerState, scene: Option<&str>, preview: Option<&str>) -> Value {
        let table = state.scenes().table();
        // If tokens are required, a client without one must not learn which scenes exist.
        let token_required = state.admission().access.is_some();
        let names: Vec<&str> = table.names().filter(|_| !token_required).collect();
        let only = match names[..] {
            [only] => Some(only),
            _ => None,
        };
        let path = scene.map_or_else(|| "/".to_owned(), path_of_scene);
        let webtransport = self.webtransport().map(
            |offer| json!({ "port": offer.port, "path": path, "certificate_hashes": offer.certificate_hashes }),
        );
        json!({
            "websocket": path,
            "scenes": names,
            "scene": scene.or(only),
            "token_required": token_required,
            "webtransport": webtransport,
            "preview": preview,
        })
    }

    /// Adds the headers that confine the page to this server. Workers obey those of their own script.
    fn confine(&self, response: &mut TextResponse, headers: &HeaderMap) {
        let set = response.headers_mut();
        for (name, value) in [
            (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
            (header::REFERRER_POLICY, "no-referrer"),
            (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
            (HeaderName::from_static("cross-origin-embedder-policy"), "require-corp"),
            (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        ] {
            set.insert(name, HeaderValue::from_static(value));
        }
        let policy = format!(
            "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; worker-src 'self'; \
             img-src 'self' blob: data:; connect-src 'self'{}; base-uri 'none'; form-action 'none'; \
             frame-ancestors 'self'",
            self.other_connections(headers).unwrap_or_default()
        );
        if let Ok(policy) = HeaderValue::from_str(&policy) {
            set.insert(header::CONTENT_SECURITY_POLICY, policy);
        }
    }

    /// This server's other ports and schemes, as sources of a policy; `None` if the request does not name the server. A
    /// source cannot hold an IPv6 address (CSP 3, section 2.3.1): such a page has WebSocket by `'self'`.
    fn other_connections(&self, headers: &HeaderMap) -> Option<String> {
        let host = host(headers)?;
        if host.host().starts_with('[') {
            return None;
        }
        let quic = self.webtransport().map(|offer| format!(" https://{}:{}", host.host(), offer.port));
        Some(format!(" ws://{host} wss://{host}{}", quic.unwrap_or_default()))
    }
}

fn whole(body: Bytes) -> TextResponse {
    Response::new(Full::new(body))
}

fn not_modified() -> TextResponse {
    let mut response = whole(Bytes::new());
    *response.status_mut() = StatusCode::NOT_MODIFIED;
    response
}

/// A preview is compressed in itself.
fn preview_file(preview: &PreviewFile, headers: &HeaderMap) -> TextResponse {
    let mut response =
        if matches_tag(headers, &preview.tag) { not_modified() } else { whole(preview.contents.clone()) };
    let set = response.headers_mut();
    set.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/octet-stream"));
    set.insert(header::CACHE_CONTROL, HeaderValue::from_static(IMMUTABLE));
    set.insert(header::ETAG, preview.tag.clone());
    response
}

fn asset(asset: &Asset, headers: &HeaderMap) -> TextResponse {
    let coding =
        Coding::ALL.into_iter().find(|coding| asset.forms.contains_key(coding) && accepts(headers, *coding));
    let Some((coding, (body, tag))) = coding.and_then(|coding| Some((coding, asset.forms.get(&coding)?)))
    else {
        return text(StatusCode::NOT_ACCEPTABLE, "this file is sent as br, gzip or identity\n");
    };
    let mut response = if matches_tag(headers, tag) { not_modified() } else { whole(body.clone()) };
    let set = response.headers_mut();
    set.insert(header::CONTENT_TYPE, HeaderValue::from_static(asset.content_type));
    set.insert(header::VARY, HeaderValue::from_static("accept-encoding"));
    if coding != Coding::Identity {
        set.insert(header::CONTENT_ENCODING, HeaderValue::from_static(coding.name()));
    }
    let cache = if asset.immutable { IMMUTABLE } else { "no-cache" };
    set.insert(header::CACHE_CONTROL, HeaderValue::from_static(cache));
    set.insert(header::ETAG, tag.clone());
    response
}

/// Whether `Accept-Encoding` admits a compression (RFC 9110, section 12.5.3). Without compression a file is sent unless
/// it is excluded.
fn accepts(headers: &HeaderMap, coding: Coding) -> bool {
    let fields = headers.get_all(header::ACCEPT_ENCODING).iter();
    let items = fields.filter_map(|field| field.to_str().ok()).flat_map(|field| field.split(','));
    let (mut named, mut any) = (None, None);
    for item in items {
        let (name, parameters) = item.split_once(';').unwrap_or((item, ""));
        let weight = parameters.trim().to_ascii_lowercase();
        let weight = weight.strip_prefix("q=").map_or(1.0, |weight| weight.parse().unwrap_or(0.0));
        let accepted = weight > 0.0_f32;
        match name.trim() {
            "*" => any = Some(accepted),
            name if name.eq_ignore_ascii_case(coding.name()) => named = Some(accepted),
            _ => {}
        }
    }
    named.or(any).unwrap_or(coding == Coding::Identity)
}

/// Whether `If-None-Match` names this entity tag (RFC 9110, section 13.1.2).
fn matches_tag(headers: &HeaderMap, tag: &HeaderValue) -> bool {
    let fields = headers.get_all(header::IF_NONE_MATCH).iter();
    let mut tags = fields.filter_map(|field| field.to_str().ok()).flat_map(|field| field.split(','));
    tags.any(|item| {
        let item = item.trim();
        item == "*" || item.strip_prefix("W/").unwrap_or(item).as_bytes() == tag.as_bytes()
    })
}
