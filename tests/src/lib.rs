//! End-to-end tests: one crate, one module per topic. All shipped parts are used: preparation, store, daemon, both
//! transports, client core, streaming thread, renderer.
//!
//! | module | what it checks |
//! |---|---|
//! | `first_flight` | the server's push alone makes every visible instance drawable, in few bytes and round trips |
//! | `settled` | a streamed scene ends up looking like the model |
//! | `textures` | a texture shared by assets is uploaded once |
//! | `texture_quality` | bytes of textures against the error of the picture |
//! | `second_uv` | maps that use a second set of texture coordinates |
//! | `walls` | neither background nor sunlight is visible through the demo's closed walls |
//! | `silence` | a vanished server is reported |
//! | `limiter` | bytes on the wire against the rate limit |
//! | `robustness` | killed clients and servers, and reconnection |
//! | `faults` | the same for many clients, and networks that reorder packets or change addresses, in virtual time |
//! | `tls` | validation of certificates, and their exchange while sessions run |
//! | `access` | tokens: admission, and messages without a valid one |
//! | `hostile` | peers that violate the protocol |
//! | `packs` | deterministic packs; caches; exports; checks |
//! | `bad_input` | wrong input by users, and packs damaged on disk |
//! | `window` | the viewer's program: first and last frame on the screen, and exit |
//! | `window_keys`, `window_parts`, `window_animations` | what keys, mouse and dropped files do in it |
//! | `local_files` | files that the viewer prepares itself |
//! | `moving_window` | the same with a moving camera: nothing disappears |
//! | `browser` | the page in a tab: picture, input, reconnection |
//! | `damage` | packs damaged while they are served |
//! | `terrain` | features of a terrain arrive, and only where a view needs them |
//! | `parts` | what parts are called: over both transports and in a published scene |
//! | `punctual_lights` | punctual lights arrive with their scene, light its picture, and do not delay the first frame |
//! | `documents` | links, files, code and commands named in documents exist; documents stay short |
//! | `wire` | docs/protocol.md and docs/formats.md are correct: a reader written from them understands recorded sessions |
//! | `dependencies` | dependencies of each crate |
//! | `interface` | the client's interface names no type of a network library |
//! | `embed` | the embedding example, built and run |
//! | `imports` | files do not import in circles |
//! | `models` | models of your own: `LODESTREAM_MODELS=DIR` |
//!
//! Scenes are generated and small. Tests on real sockets use loopback and fail after a time far above what they need;
//! whatever measures time runs in virtual time.

#![cfg_attr(
    test,
    allow(clippy::unwrap_used, reason = "test helpers without #[test] may unwrap, as tests may")
)]

#[cfg(test)]
mod access;
#[cfg(test)]
mod animations;
#[cfg(test)]
mod bad_input;
#[cfg(test)]
mod browser;
#[cfg(test)]
mod damage;
#[cfg(test)]
mod dependencies;
#[cfg(test)]
mod documents;
#[cfg(test)]
mod embed;
#[cfg(test)]
mod faults;
#[cfg(test)]
mod first_flight;
#[cfg(test)]
mod hostile;
#[cfg(test)]
mod imports;
#[cfg(test)]
mod interface;
#[cfg(test)]
mod limiter;
#[cfg(test)]
mod local_files;
#[cfg(test)]
mod merged_parts;
#[cfg(test)]
mod models;
#[cfg(test)]
mod moving_window;
#[cfg(test)]
mod packs;
#[cfg(test)]
mod parts;
#[cfg(test)]
mod punctual_lights;
#[cfg(test)]
mod robustness;
#[cfg(test)]
mod second_uv;
#[cfg(test)]
mod settled;
#[cfg(test)]
mod silence;
#[cfg(test)]
mod skins;
#[cfg(test)]
mod static_host;
#[cfg(test)]
mod stores;
#[cfg(test)]
mod support;
#[cfg(test)]
mod terrain;
#[cfg(test)]
mod texture_quality;
#[cfg(test)]
mod textures;
#[cfg(test)]
mod tls;
#[cfg(test)]
mod walls;
#[cfg(test)]
mod window;
#[cfg(test)]
mod window_animations;
#[cfg(test)]
mod window_keys;
#[cfg(test)]
mod window_parts;
#[cfg(test)]
mod wire;
