//! The overlay: progress, link, quality, switches of techniques; and pictures of the whole page.

use serde_json::json;

use super::devtools::Tab;
use super::page::{STATS, mouse, press, serve, settle};
use super::{image, tab};
use crate::support::PICTURE_PX;
use crate::support::picture::keep_file;
use crate::support::scene::TestScene;

/// Clicks the middle of an element.
fn click(tab: &mut Tab, element: &str) {
    let middle = tab.evaluate(&format!(
        "(({{ x, y, width, height }}) => [x + width / 2, y + height / 2])({element}.getBoundingClientRect())"
    ));
    let at: [f64; 2] = serde_json::from_value(middle).unwrap();
    mouse(tab, "mousePressed", at, json!({ "button": "left", "buttons": 1, "clickCount": 1 }));
    mouse(tab, "mouseReleased", at, json!({ "button": "left", "clickCount": 1 }));
}

const SUMMARY: &str = "document.querySelector('#overlay summary')";
const FIGURES: &str = "document.querySelector('#overlay .figures').textContent";

#[test]
fn the_overlay_shows_progress_link_and_quality() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let server = serve(TestScene::small());
    settle(&mut tab, &format!("{}#transport=ws", server.page_url()));
    let status = "document.querySelector('#overlay .status').textContent";
    tab.wait("it is settled", status, |text| text == "settled");
    // Two reports a second apart, 500 kB more in the second.
    let shown = tab.evaluate(
        "(() => {
            const clock = performance.now;
            const begun = performance.now() + 10_000;
            const tell = (ms, bytes) => {
                performance.now = () => begun + ms;
                const figures = { settled: false, bytes, needed_bytes: 4e6, missing_bytes: 1e6, rtt_ms: 51.2 };
                const detail = { ...lodestream.stats(), ...figures };
                lodestream.view.dispatchEvent(new CustomEvent('progress', { detail }));
            };
            tell(0, 1_000_000);
            tell(1000, 1_500_000);
            performance.now = clock;
            const overlay = document.getElementById('overlay');
            const text = (part) => overlay.querySelector(part).textContent;
            return [text('.status'), text('.figures'), overlay.querySelector('.bar').value];
        })()",
    );
    assert_eq!(shown[0], "refining: 1.00 MB to come, 2.0 s left");
    assert_eq!(shown[2], 0.75);
    let figures = shown[1].as_str().unwrap();
    for part in
        ["1.50 MB received", "link: ws, 4.00 Mbit/s, round trip 51 ms", "quality: ", "first frame ", "faces"]
    {
        assert!(figures.contains(part), "{part}: {figures}");
    }
    server.assert_healthy();
}

#[test]
fn a_technique_is_switched_in_the_overlay_and_keys_work_on() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let server = serve(TestScene::small());
    settle(&mut tab, &server.page_url());
    click(&mut tab, SUMMARY);
    tab.wait("the overlay opens", "document.getElementById('overlay').open", |open| *open == true);
    let whole = image(&mut tab, "lodestream.view.picture()");
    let shadows = "[...document.querySelectorAll('#overlay label')].find((label) => label.textContent.includes('shadows'))";
    let checked = format!("{shadows}.firstChild.checked");
    click(&mut tab, shadows);
    assert_eq!(tab.evaluate(&checked), false);
    tab.wait("it settles without shadows", STATS, |stats| stats["settled"] == true);
    let without = image(&mut tab, "lodestream.view.picture()");
    let lighter =
        without.pixels().zip(whole.pixels()).filter(|(a, b)| a.0[1] > b.0[1].saturating_add(8)).count();
    assert!(lighter > 500, "{lighter} pixels were in shadow");
    // The box has the focus now; keys are still the page's.
    press(&mut tab, 'H');
    assert_eq!(tab.evaluate("document.getElementById('overlay').checkVisibility()"), false);
    press(&mut tab, 'H');
    click(&mut tab, shadows);
    tab.wait("it settles with shadows", STATS, |stats| stats["settled"] == true);
    let again = image(&mut tab, "lodestream.view.picture()");
    let differing =
        again.pixels().zip(whole.pixels()).filter(|(a, b)| (0..3).any(|i| a.0[i].abs_diff(b.0[i]) > 3));
    assert!(differing.count() < 50, "the shadows are as before");
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}

#[test]
fn the_whole_page_fits_desks_and_phones() {
    let Some(mut tab) = tab([1280, 800]) else { return };
    let server = serve(TestScene::small());
    for (name, phone) in [("page-desk", None), ("page-phone", Some([390, 844]))] {
        if let Some(size_px) = phone {
            tab.be_a_phone(size_px, 3.0);
        }
        tab.navigate("about:blank");
        tab.navigate(&server.page_url());
        // Without a GPU a settled picture of a phone's pixels takes a minute; the first with all meshes shows enough.
        tab.wait("the page", "typeof lodestream", |kind| kind == "object");
        tab.evaluate(
            "['occlusion', 'shadows', 'relief'].forEach((name) => lodestream.view.switch(name, false))",
        );
        tab.wait("a picture with all meshes", STATS, |stats| {
            let count = |name: &str| stats[name].as_f64().unwrap_or(0.0);
            count("frame_count") > 0.0 && count("needed_bytes") > 0.0 && count("missing_bytes") == 0.0
        });
        keep_file(&tab.screenshot(), &format!("{name}-closed"));
        tab.evaluate("void (document.getElementById('overlay').open = true)");
        tab.wait("figures are shown", FIGURES, |text| {
            text.as_str().is_some_and(|text| text.contains("quality"))
        });
        keep_file(&tab.screenshot(), name);
        // Nothing sticks out of the page, and fingers hit what can be pressed.
        let faults = tab.evaluate(
            "[...document.querySelectorAll('#overlay, #overlay *')].filter((part) => part.checkVisibility()).flatMap((part) => {
                const { left, top, right, bottom, height } = part.getBoundingClientRect();
                const outside = left < 0 || top < 0 || right > innerWidth || bottom > innerHeight;
                const pressed = part.matches('summary, label, button') && matchMedia('(pointer: coarse)').matches;
                return outside || (pressed && height < 32) ? [`${part.tagName} ${part.className}: ${[left, top, right, bottom]}`] : [];
            })",
        );
        assert_eq!(faults, json!([]), "{name}");
    }
    server.assert_healthy();
}
