//! Streaming client core, renderer and viewer.
