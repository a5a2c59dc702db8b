//! Streaming from a published scene by HTTP range requests: any web server, CDN or folder takes the server's place.
//!
//! [`RangeSession`] has the interface of the protocol's client session where it can, so that the core selects, caches
//! and decodes as with a server: it takes wanted blobs and gives events. Instead of messages it gives requests for byte
//! ranges and takes responses. No I/O, time is an argument; drivers fetch.
//!
//! ```text
//! wanted blobs -> pending items -> groups of neighbours -> requests -> driver
//!                     ^ places                                           |
//!                  Directory <- opening, pages, lists, tables <- items <- bytes, checked
//! ```
//!
//! | module | responsibility |
//! |---|---|
//! | `session` | wanted blobs in, requests out; responses in, events out |
//! | `directory` | what is known of the scene's layout: the place of each blob |
//! | `items` | what is to be fetched, and how urgently |
//! | `grouping` | neighbours that one request fetches |
//! | `request` | requests, as drivers take them |
//! | `response` | status and range of a response |

mod directory;
mod grouping;
mod items;
mod request;
mod response;
mod session;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;

pub use grouping::RangeSettings;
pub use request::{Object, RangeRequest};
pub use response::{ContentRange, ResponseHead};
pub use session::RangeSession;
