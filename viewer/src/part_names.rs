//! Prints what parts are called (`--part`).

use std::io::Write as _;
use std::time::{Duration, Instant};

use anyhow::bail;
use lodestream_client::core::PartAnswer;
use lodestream_client::streaming::Streaming;
use serde_json::{Value, json};

use crate::args::Args;

/// Pause between two looks for an answer.
const PAUSE: Duration = Duration::from_millis(5);

/// Looks up the parts of the command line and prints a line of JSON for each, in their order.
///
/// # Errors
/// No answer in `limit`.
pub(crate) fn print(args: &Args, streaming: &mut Streaming, limit: Duration) -> anyhow::Result<()> {
    let begun = Instant::now();
    for part in &args.part {
        let id = part.0;
        let answer = if streaming.look_up_part(id) {
            loop {
                if let Some(answer) = streaming.take_part() {
                    break answer;
                }
                if begun.elapsed() >= limit {
                    bail!("part {}:{}: no answer came in time; raise --timeout", id.instance, id.part);
                }
                std::thread::sleep(PAUSE);
            }
        } else {
            bail!("part {}:{} cannot be looked up: the session has ended", id.instance, id.part);
        };
        // A closed pipe is not an error.
        let _ = writeln!(std::io::stdout(), "{}", line(&answer));
    }
    Ok(())
}

/// An answer as a line of JSON. The texts come from a server: characters that change how a terminal shows others are
/// escaped.
fn line(answer: &PartAnswer) -> String {
    let mut object = json!({"instance": answer.id.instance, "part": answer.id.part});
    match &answer.info {
        Ok(info) => {
            let extras = info
                .extras
                .as_deref()
                .map_or(Value::Null, |text| serde_json::from_str(text).unwrap_or_else(|_| Value::from(text)));
            object["name"] = info.name.as_str().into();
            object["path"] = info.path.as_str().into();
            object["extras"] = extras;
        }
        Err(absence) => object["absence"] = absence.to_string().into(),
    }
    let hidden = |c: char| {
        c.is_control()
            || matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
    };
    let escaped = |c: char| if hidden(c) { format!("\\u{:04x}", u32::from(c)) } else { c.to_string() };
    object.to_string().chars().map(escaped).collect()
}

#[cfg(test)]
mod tests {
    use lodestream_client::core::PartAbsence;
    use lodestream_scene::parts::PartInfo;
    use lodestream_scene::parts::ScenePart;
    use lodestream_scene::placement::Placement;

    use super::*;

    #[test]
    fn answers_are_lines_of_json_without_hidden_characters() {
        let id = ScenePart { instance: 2, part: 7 };
        let info = PartInfo {
            name: "door\u{9b}31m\n\u{202e}\"x\"".into(),
            path: "site/größe".into(),
            extras: Some("{\"id\":7}".into()),
            in_file: Placement::default(),
        };
        let text = line(&PartAnswer { id, info: Ok(info.clone()) });
        assert!(text.contains("größe") && !text.contains(['\u{9b}', '\n', '\u{202e}']), "{text}");
        let read: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(
            read,
            json!({"instance": 2, "part": 7, "name": info.name, "path": info.path, "extras": {"id": 7}})
        );
        let text = line(&PartAnswer { id, info: Err(PartAbsence::NoSuchPart) });
        assert!(text.contains("\"absence\":\"there is no such part\""), "{text}");
    }
}
