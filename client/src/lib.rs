//! Streaming client: session, cache, selection, refinement, network. It draws nothing and opens no window.
//!
//! A program that draws asks [`streaming::Streaming`] for a scene and takes [`core::Change`]s, each of which leaves a
//! picture without holes; `lodestream_render::SceneView` puts them into GPU memory. Everything heavy happens on
//! threads of the client's own.
//!
//! | feature | brings | without it |
//! |---|---|---|
//! | `quic` | `quic://` addresses (quinn, rustls) | such an address ends the session with a message |
//! | `websocket` | `ws://` addresses (tungstenite) | the same |
//! | `tls` | `wss://` addresses (rustls), and with it `websocket` | the same |
//! | `zstd` | blobs that are zstd frames: packs of the plain codec, and base meshes that are smaller so | they are refused as damaged, with a message that names the feature; the asset stays away |
//! | `runtime` | sessions on a tokio runtime of the host's, in virtual time too | `Streaming` runs its own |
//!
//! All but `runtime` are on by default. Without transports there is neither `streaming` nor tokio: a host reads
//! frames from where it likes and feeds [`core::ClientCore`]. That, without `zstd`, links no C and compiles for
//! `wasm32-unknown-unknown`.

pub mod core;
pub mod net;
#[cfg(any(feature = "quic", feature = "websocket"))]
pub mod streaming;
pub mod threads;
