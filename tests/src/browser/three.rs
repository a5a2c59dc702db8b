//! The npm package's example with three.js: a streamed scene drawn by WebGL.

use serde_json::json;

use super::devtools::WEBGL;
use super::files::Files;
use super::npm::{serve_for, websocket};
use super::{built_package, image, skip, tab_with};
use crate::support::PICTURE_PX;
use crate::support::picture::{Picture, draw, headless, keep};
use crate::support::scene::TestScene;

/// Least share of the pixels that both or either of two silhouettes cover which both cover. Edges are sampled
/// differently.
const MIN_COMMON: f64 = 0.97;
/// What `npm ci` installs in the example's folder of the package, as `script/test` does.
const THREE: &str = "examples/three/node_modules/three/build/three.module.js";

/// Geometries and textures of the device.
const MEMORY: &str = "[example.renderer.info.memory.geometries, example.renderer.info.memory.textures]";

/// Draws before a background that no surface has the colour of.
const SHOW: &str = "window.show = (streamed, own) => {
    const { THREE, scene } = example;
    scene.background = new THREE.Color(0, 1, 0);
    [example.streamed.visible, example.own.visible] = [streamed, own];
    example.draw();
    return new Promise((done) => example.renderer.domElement.toBlob(done));
}; 0";

fn covered(image: &image::RgbaImage) -> Vec<bool> {
    image.pixels().map(|pixel| pixel.0[..3] != [0, 255, 0]).collect()
}

fn share(covered: &[bool]) -> f64 {
    covered.iter().filter(|covered| **covered).count() as f64 / covered.len() as f64
}

#[test]
fn the_example_draws_the_scene_with_three_and_refines_it() {
    if !built_package().join(THREE).exists() {
        return skip("three.js is absent: npm ci in the package's examples/three, as script/test does");
    }
    let (Some(mut tab), Some(mut headless)) = (tab_with(PICTURE_PX, WEBGL), headless()) else { return };
    let scene = TestScene::small();
    let files = Files::start(built_package(), String::new());
    let server = serve_for(scene, &files);
    tab.navigate(&format!("{}/examples/three/index.html?src={}", files.origin(), websocket(&server)));
    tab.wait("the page", "typeof example", |kind| kind == "object");
    let settled = "example.streamed.connection.stats()";
    tab.wait("it settles", settled, |stats| stats["settled"] == true);

    let native = draw(&mut headless, scene.whole());
    let whole =
        image(&mut tab, "(example.draw(), new Promise((done) => example.renderer.domElement.toBlob(done)))");
    keep(&Picture { image: whole, covered: Vec::new() }, "three");
    tab.evaluate(SHOW);
    let streamed = image(&mut tab, "show(true, false)");
    let own = image(&mut tab, "show(false, true)");
    let nothing = image(&mut tab, "show(false, false)");
    assert_eq!(share(&covered(&nothing)), 0.0);
    let shown = covered(&streamed);
    let count = |both: fn(bool, bool) -> bool| {
        shown.iter().zip(&native.covered).filter(|(a, b)| both(**a, **b)).count() as f64
    };
    let common = count(|a, b| a && b) / count(|a, b| a || b);
    println!("{common} of the silhouettes in common, own mesh covers {}", share(&covered(&own)));
    assert!(common > MIN_COMMON, "{common}");
    assert!(share(&covered(&own)) > 0.005, "the page's own mesh is drawn");
    // Lit and textured, not one colour.
    let colours: std::collections::BTreeSet<[u8; 4]> = streamed.pixels().map(|pixel| pixel.0).collect();
    assert!(colours.len() > 500, "{} colours", colours.len());

    let before = tab.evaluate("example.streamed.faces");
    tab.evaluate(
        "(() => { const { camera, controls, streamed, draw } = example;
            streamed.visible = true;
            camera.position.sub(controls.target).multiplyScalar(0.5).add(controls.target);
            draw(); })()",
    );
    tab.wait("it settles nearer", settled, |stats| stats["settled"] == true);
    let after = tab.evaluate("example.streamed.faces");
    println!("{before} faces, {after} nearer");
    assert!(after.as_u64() > before.as_u64(), "{before} faces, {after} nearer");
    let near = image(&mut tab, "show(true, true)");
    keep(&Picture { image: near, covered: Vec::new() }, "three-near");

    server.wait_for_sessions(1);
    let held = tab.evaluate(MEMORY);
    let holds = |at: usize| held[at].as_u64();
    assert!(holds(0) > Some(4) && holds(1) > Some(1), "{held}");
    tab.evaluate("(example.scene.remove(example.streamed), example.draw(), 0)");
    server.wait_for_sessions(0);
    // Of what is left, the geometry is the page's own mesh and the texture three's own table for its materials.
    assert_eq!(tab.evaluate(MEMORY), json!([1, 1]), "{held}");
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}
