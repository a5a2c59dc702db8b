//! The worker's half of lookups of parts.

use js_sys::Array;
use lodestream_client::core::PartAnswer;
use lodestream_scene::parts::ScenePart;
use wasm_bindgen::prelude::*;

use crate::stats::fields;
use crate::{Streamer, time};

#[wasm_bindgen]
impl Streamer {
    /// Looks up what a part is called; [`Streamer::parts`] gives the answer.
    pub fn look_up_part(&mut self, now_ms: f64, instance: u32, part: u32) {
        self.core.look_up_part(time(now_ms), ScenePart { instance, part });
    }

    /// Answers to lookups: objects with `instance`, `part`, and either `info` (`name`, `path`, `extras` as JSON text or
    /// absent) or `absence`, the reason.
    #[must_use]
    pub fn parts(&mut self) -> Array {
        std::iter::from_fn(|| self.core.take_part()).map(|answer| object(&answer)).collect()
    }
}

fn object(answer: &PartAnswer) -> JsValue {
    let (info, absence) = match &answer.info {
        Ok(info) => {
            let extras = info.extras.as_deref().map_or(JsValue::UNDEFINED, JsValue::from);
            let info = fields([
                ("name", info.name.as_str().into()),
                ("path", info.path.as_str().into()),
                ("extras", extras),
            ]);
            (info.into(), JsValue::UNDEFINED)
        }
        Err(absence) => (JsValue::UNDEFINED, absence.to_string().into()),
    };
    let ScenePart { instance, part } = answer.id;
    fields([("instance", instance.into()), ("part", part.into()), ("info", info), ("absence", absence)])
        .into()
}
