//! What is sent next.
