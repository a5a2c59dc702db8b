//! A texture shared by assets is uploaded once, as it is sent once.

use lodestream_bake::scene::of_files;
use lodestream_client::core::Change;
use lodestream_render::{Headless, SceneView};

use crate::support::picture::{Picture, headless};
use crate::support::scene::{TestScene, prepare_all};
use crate::support::shapes::write_wall;

/// Two walls side by side with the same textures: a colour and a height map.
fn two_walls() -> TestScene {
    let folder = tempfile::tempdir().unwrap();
    write_wall(folder.path());
    let low = std::fs::read_to_string(folder.path().join("wall.obj")).unwrap().replace("0.9", "0.5");
    std::fs::write(folder.path().join("low.obj"), low).unwrap();
    let asset =
        |name: &str| format!("\n[[asset]]\nname = \"{name}\"\nfile = \"{name}.obj\"\nrelief_depth = 0.02\n");
    let instance =
        |name: &str, x: f64| format!("\n[[instance]]\nasset = \"{name}\"\ntranslation = [{x}, 0.0, 0.0]\n");
    let camera = "[camera]\neye = [0.0, 0.6, 4.2]\ntarget = [0.0, 0.0, 0.0]\nfov_y_degrees = 42.0\n";
    let parts = [asset("wall"), asset("low"), instance("wall", -1.3), instance("low", 1.3)];
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, format!("name = \"walls\"\n\n{camera}{}", parts.concat())).unwrap();
    let scene = of_files(&[path]).unwrap();
    TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")))
}

/// Uploads and draws.
fn shown(h: &mut Headless, view: &mut SceneView, changes: Vec<Change>) -> Picture {
    view.push(changes);
    view.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
    let camera = view.header().unwrap().camera.pose();
    view.with_frame(camera, Default::default(), f32::MAX, |frame| h.frame(frame)).unwrap();
    Picture { image: h.picture().unwrap(), covered: h.coverage().unwrap() }
}

#[test]
fn a_shared_texture_is_uploaded_once() {
    let Some(mut h) = headless() else { return };
    let scene = two_walls();
    assert_eq!(scene.entry(1).shared.len(), 2);
    let whole = scene.whole();
    let mut apart = whole.clone();
    for change in &mut apart {
        if let Change::Asset(asset) = change {
            asset.shared.clear();
        }
    }
    let (mut one, mut each) = (SceneView::new(), SceneView::new());
    let shared = shown(&mut h, &mut one, whole);
    let for_each = shown(&mut h, &mut each, apart.clone());
    assert!(shared.image == for_each.image && shared.covered.iter().any(|covered| *covered));
    let ((count, bytes), (copies, in_all)) = (one.textures(), each.textures());
    println!("{count} textures of {bytes} bytes in place of {copies} of {in_all}");
    // A colour takes four bytes per texel, a height one or two; mip levels add a third.
    assert!(bytes > 128 * 128 * 5);
    assert_eq!((count, copies, in_all), (2, 4, 2 * bytes));
    // The next scene has textures of its own.
    let again = shown(&mut h, &mut one, apart);
    assert!(again.image == shared.image);
    assert_eq!(one.textures(), (4, 2 * bytes));
}
