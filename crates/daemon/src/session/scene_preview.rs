//! Preview of a scene for the page.

use std::sync::Arc;

use bytes::Bytes;
use hyper::header::HeaderValue;
use lodestream_preview::{MAX_ASSETS, PreviewError, encode, file_name};
use lodestream_protocol::source::{SceneSource, SourceError};
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::ScenePage;

use crate::http::page::entity_tag;

/// A preview as a file, named by content.
#[derive(Debug)]
pub(crate) struct PreviewFile {
    pub(crate) name: String,
    pub(crate) contents: Bytes,
    pub(crate) tag: HeaderValue,
}

/// Why a scene has no preview.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NoPreview {
    #[error(transparent)]
    Scene(#[from] PreviewError),
    #[error(transparent)]
    Source(#[from] SourceError),
}

impl PreviewFile {
    /// Reads base meshes, so it may block.
    ///
    /// # Errors
    /// A blob cannot be read or decoded, or there is nothing to show.
    pub(crate) fn of(source: &dyn SceneSource) -> Result<Self, NoPreview> {
        let (mut pages, mut assets): (Vec<Arc<ScenePage>>, usize) = (Vec::new(), 0);
        while assets < MAX_ASSETS
            && let Some(page) = u32::try_from(pages.len()).ok().and_then(|number| source.page(number))
        {
            assets += page.assets.len().saturating_sub(page.proxies.len());
            pages.push(page);
        }
        let read = |asset, part| {
            let bytes = source.read(&BlobId::Asset { asset, part })?;
            Ok::<_, NoPreview>(Some(bytes.to_vec()))
        };
        Ok(Self::named(encode(source.header(), &pages, read)?))
    }

    /// A file of these contents.
    pub(crate) fn named(contents: Vec<u8>) -> Self {
        let name = file_name(&contents);
        Self { name, tag: entity_tag(&contents), contents: contents.into() }
    }
}
