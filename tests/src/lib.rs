//! End-to-end tests: one crate, one module per topic. Everything that ships takes part: preparation,
//! store, daemon, both transports, client core, streaming thread, renderer.
//!
//! | module | what it guards |
//! |---|---|
//! | `first_flight` | the server's push alone makes every visible instance drawable, in few bytes and round trips |
//! | `settled` | what is streamed ends up looking like the model |
//! | `textures` | a texture that assets share is one on the device |
//! | `walls` | nothing is seen, and no sunlight comes, through the demo's closed walls |
//! | `silence` | a server that is gone without a word is told |
//! | `limiter` | bytes on the wire against the rate |
//! | `robustness` | clients and servers that die, and come back |
//! | `faults` | the same for many clients, and networks that reorder packets or change addresses, in virtual time |
//! | `tls` | certificates: who is believed, and their exchange while sessions run |
//! | `access` | tokens: who is let in, and what others are told |
//! | `hostile` | peers that break every rule |
//! | `packs` | the same input gives the same packs; caches; exports; checks |
//! | `bad_input` | what users may get wrong, and what disks may do to packs |
//! | `window` | the viewer's program: what is on the screen, first and at last, and how it ends |
//! | `moving_window` | the same while a user moves the camera: nothing that was there goes |
//! | `damage` | packs that are damaged while they are served |
//! | `terrain` | features of a terrain arrive, and only where a view needs them |
//! | `punctual_lights` | punctual lights arrive with their scene, light its picture, and keep no first frame waiting |
//! | `documents` | what documents name is there: links, files, code, commands |
//! | `wire` | docs/protocol.md is true: a reader written from it understands recorded sessions |
//! | `dependencies` | what each crate makes its users compile |
//! | `interface` | what each type in the client's interface is of |
//! | `embed` | a program of somebody else's that draws the scene, built and run |
//! | `imports` | files do not import in circles |
//! | `models` | models of your own: `LODESTREAM_MODELS=DIR` |
//!
//! Scenes are generated and small. Tests on real sockets use loopback and give up after a bound that is
//! far above what they take; whatever measures time runs in virtual time.

#![cfg_attr(
    test,
    allow(
        clippy::unwrap_used,
        reason = "helpers of tests are tests, whatever the lint thinks of functions without #[test]"
    )
)]

#[cfg(test)]
mod access;
#[cfg(test)]
mod bad_input;
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
mod models;
#[cfg(test)]
mod moving_window;
#[cfg(test)]
mod packs;
#[cfg(test)]
mod punctual_lights;
#[cfg(test)]
mod robustness;
#[cfg(test)]
mod settled;
#[cfg(test)]
mod silence;
#[cfg(test)]
mod stores;
#[cfg(test)]
mod support;
#[cfg(test)]
mod terrain;
#[cfg(test)]
mod textures;
#[cfg(test)]
mod tls;
#[cfg(test)]
mod walls;
#[cfg(test)]
mod window;
#[cfg(test)]
mod wire;
