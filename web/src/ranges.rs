//! The worker's half for published scenes: range requests that the script makes.

use js_sys::{Object, Reflect};
use lodestream_client::ranges::{ContentRange, ResponseHead};
use wasm_bindgen::prelude::*;

use crate::{Streamer, time};

#[wasm_bindgen]
impl Streamer {
    /// Begins to read a published scene.
    pub fn connect_ranges(&mut self, now_ms: f64) {
        self.core.connect_ranges(time(now_ms));
    }

    /// The next request to make: `id`; `name` of the object beside the scene, absent for the scene itself; `start`, `end`
    /// of its bytes; `reload`, whether caches must ask the server again.
    pub fn request(&mut self, now_ms: f64) -> Option<Object> {
        let request = self.core.poll_request(time(now_ms))?;
        let object = Object::new();
        let set = |name: &str, value: JsValue| {
            // Setting a property of a plain object does not fail.
            let _ = Reflect::set(&object, &name.into(), &value);
        };
        // JavaScript's numbers are exact to 2⁵³, beyond the length of any object.
        set("id", (request.id as f64).into());
        set("name", request.object.name().map_or(JsValue::UNDEFINED, Into::into));
        set("start", (request.range.start as f64).into());
        set("end", (request.range.end as f64).into());
        set("reload", request.reload.into());
        Some(object)
    }

    /// The next request to abort.
    pub fn cancelled(&mut self) -> Option<f64> {
        self.core.poll_cancelled().map(|id| id as f64)
    }

    /// Takes the head of a response.
    pub fn response_head(
        &mut self,
        now_ms: f64,
        id: f64,
        status: u16,
        content_range: Option<String>,
        encoded: bool,
    ) {
        let content_range = content_range.as_deref().and_then(ContentRange::parse);
        let head = ResponseHead { status, content_range, encoded };
        self.core.handle_response_head(time(now_ms), id as u64, &head);
    }

    /// Takes bytes of a response, in order.
    pub fn response_body(&mut self, now_ms: f64, id: f64, bytes: &[u8]) {
        self.count(bytes.len());
        self.core.handle_response_body(time(now_ms), id as u64, bytes);
    }

    /// Takes the end of a response.
    pub fn response_end(&mut self, now_ms: f64, id: f64) {
        self.core.handle_response_end(time(now_ms), id as u64);
    }

    /// Takes the failure of a request.
    pub fn request_failed(&mut self, now_ms: f64, id: f64, why: &str) {
        self.core.handle_request_failure(time(now_ms), id as u64, why);
    }

    /// What is wrong with the source for the present.
    #[must_use]
    pub fn trouble(&self) -> Option<String> {
        self.core.trouble().map(str::to_owned)
    }
}
