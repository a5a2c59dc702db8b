//! The view in the page's address: written there, read at the start, and followed when it changes.

use serde_json::Value;

use super::devtools::Tab;
use super::page::{CAMERA, camera, drag, moved, serve, settle};
use super::tab;
use crate::support::PICTURE_PX;
use crate::support::scene::TestScene;

/// Whether two cameras are equal but for the rounding of the address.
fn same(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-6 * (1.0 + b.abs()))
}

/// The address, once it states the camera.
fn address(tab: &mut Tab, of: &[f64]) -> String {
    let eye = tab
        .evaluate(&format!("[{}, {}, {}].map((x) => Number(x.toPrecision(9))).join()", of[0], of[1], of[2]));
    let eye = format!("eye={}", eye.as_str().unwrap());
    let hash = tab.wait("the address has the camera", "location.hash", |hash| {
        hash.as_str().is_some_and(|hash| hash.contains(&eye))
    });
    hash.as_str().unwrap().to_owned()
}

#[test]
fn a_page_starts_from_the_view_in_its_address_and_follows_it() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let server = serve(TestScene::small());
    settle(&mut tab, &format!("{}#transport=ws;memory=300", server.page_url()));
    let start = camera(&mut tab);
    drag(&mut tab, [300.0, 200.0], [380.0, 160.0]);
    let turned = moved(&mut tab, "a drag turns the camera", |camera| camera[..3] != start[..3]);
    let link = address(&mut tab, &turned);
    // The other parts of the address stay.
    assert!(link.contains("transport=ws") && link.contains("memory=300"), "{link}");

    tab.navigate("about:blank");
    settle(&mut tab, &format!("{}{link}", server.page_url()));
    let opened = camera(&mut tab);
    assert!(same(&opened, &turned), "{opened:?} of {link}, not {turned:?}");
    assert!(!same(&opened, &start), "it was to be another view than the scene's");

    // A person edits the address, or follows a link to the same page.
    tab.evaluate("void (location.hash = 'eye=1,2,6;target=0,0.5,0;up=0,1,0;fov=40')");
    let expected = [1.0, 2.0, 6.0, 0.0, 0.5, 0.0, 0.0, 1.0, 0.0, 40_f64.to_radians()];
    let followed = moved(&mut tab, "the camera follows the address", |camera| same(camera, &expected));
    address(&mut tab, &followed);
    // Numbers that are no camera change nothing.
    tab.evaluate("void (location.hash = 'eye=1,2;target=x')");
    tab.evaluate("new Promise((done) => setTimeout(done))");
    let after: Vec<f64> = serde_json::from_value(tab.evaluate(CAMERA)).unwrap();
    assert!(same(&after, &expected), "{after:?}");
    tab.wait("it settles there", "lodestream.stats().settled", |settled| *settled == Value::Bool(true));
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}
