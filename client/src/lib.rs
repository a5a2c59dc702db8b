//! Streaming client: session, cache, selection, refinement and network. It draws nothing and opens no window.
//!
//! A program that draws starts [`streaming::Streaming`] and takes [`core::Change`]s from it, each of which leaves a
//! picture without holes; `lodestream_render::SceneView` uploads them to GPU memory. All heavy work runs on the
//! client's own threads.
//!
//! | feature | enables | without it |
//! |---|---|---|
//! | `quic` | `quic://` addresses (quinn, rustls) | such an address ends the session with a message |
//! | `websocket` | `ws://` addresses (tungstenite) | the same |
//! | `tls` | `wss://` addresses (rustls), and with it `websocket` | the same |
//! | `http` | `https://`, `http://` and `file:` addresses of published scenes (hyper), and with it `tls` | the same |
//! | `zstd` | the C decoder of zstd frames: packs of the codec `Zstd`, and base meshes that zstd makes smaller | a slower decoder in Rust |
//! | `images` | decoders of PNG, JPEG and WebP texture levels | the host decodes them (`core::TexturePixels::File`) |
//! | `runtime` | sessions on the host's tokio runtime, in virtual time too | only `Streaming`, which runs its own |
//!
//! All but `runtime` are on by default. Without transports there is neither `streaming` nor tokio: the host passes
//! frames from its own transport to [`core::ClientCore`], which without `zstd` links no C and compiles for
//! `wasm32-unknown-unknown`.

pub mod core;
pub mod net;
pub mod ranges;
#[cfg(any(feature = "quic", feature = "websocket"))]
pub mod streaming;

pub use lodestream_threads::Threads;
