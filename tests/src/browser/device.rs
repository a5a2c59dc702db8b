//! A graphics device that is lost: the page goes on with another one.

use serde_json::json;

use lodestream_report::image_error::image_error;

use super::page::{STATS, serve, settle};
use super::{image, tab};
use crate::support::PICTURE_PX;
use crate::support::scene::TestScene;

/// Keeps each device that the page opens in `devices`, so that a test can destroy it.
const KEEP_DEVICES: &str = "
    window.devices = [];
    const open = GPUAdapter.prototype.requestDevice;
    GPUAdapter.prototype.requestDevice = async function (...how) {
        const device = await open.apply(this, how);
        window.devices.push(device);
        return device;
    };";

#[test]
fn a_lost_device_is_replaced_within_the_same_session() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let server = serve(TestScene::small());
    tab.call("Page.addScriptToEvaluateOnNewDocument", json!({ "source": KEEP_DEVICES }));
    let before = settle(&mut tab, &server.page_url());
    let first = image(&mut tab, "lodestream.view.picture()");
    let mut bytes = before["bytes"].as_f64().unwrap();
    // While nothing is drawn, and between the frames of a moving camera.
    for (lost, by) in [
        (1.0, "window.devices.at(-1).destroy()"),
        (
            2.0,
            "lodestream.view.viewer.turn(performance.now(), 40, 0), lodestream.view.redraw(), window.devices.at(-1).destroy()",
        ),
    ] {
        tab.evaluate(&format!("void ({by})"));
        let after = tab.wait("another device draws the scene", STATS, |stats| {
            stats["devices"].as_f64() == Some(lost + 1.0) && stats["settled"] == true
        });
        assert_eq!(after["connections"], before["connections"], "it is the same session: {after}");
        if lost == 1.0 {
            assert_eq!(after["faces"], before["faces"], "{after}");
            // Pings and answers.
            let more = after["bytes"].as_f64().unwrap() - bytes;
            assert!(more < 1000.0, "{more} bytes came again: {after}");
            let again = image(&mut tab, "lodestream.view.picture()");
            let flip = image_error(&again, &first).unwrap().flip;
            assert!(flip <= 0.002, "{flip}: another picture");
        }
        bytes = after["bytes"].as_f64().unwrap();
    }
    server.assert_healthy();
}
