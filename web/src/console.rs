//! Warnings and errors of the client in the browser's console.

use std::fmt::{Debug, Write as _};
use std::sync::atomic::{AtomicU32, Ordering};

use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Level, Metadata, Subscriber};
use wasm_bindgen::prelude::*;

/// Most lines of one page or worker: a fault that each frame repeats would fill the console.
const MAX_LINES: u32 = 100;

static LINES: AtomicU32 = AtomicU32::new(0);

struct Console;

/// The text of an event: its message, then its fields.
#[derive(Default)]
struct Text(String);

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        // Writing to a string does not fail.
        let _ = match field.name() {
            "message" => write!(self.0, "{value:?}"),
            name => write!(self.0, " {name}={value:?}"),
        };
    }
}

impl Subscriber for Console {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        *metadata.level() <= Level::WARN && LINES.load(Ordering::Relaxed) < MAX_LINES
    }

    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn event(&self, event: &Event<'_>) {
        LINES.fetch_add(1, Ordering::Relaxed);
        let mut text = Text::default();
        event.record(&mut text);
        let text = JsValue::from(text.0);
        match *event.metadata().level() {
            Level::ERROR => web_sys::console::error_1(&text),
            _ => web_sys::console::warn_1(&text),
        }
    }

    fn enter(&self, _: &Id) {}

    fn exit(&self, _: &Id) {}
}

/// Runs when page or worker loads the module.
#[wasm_bindgen(start)]
fn start() {
    // The one subscriber of this instance.
    let _ = tracing::subscriber::set_global_default(Console);
}
