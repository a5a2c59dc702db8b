//! A texture shared by assets is uploaded once, as it is sent once; tiles come from every source alike.

use std::collections::BTreeSet;

use lodestream_bake::scene::of_files;
use lodestream_client::core::{Change, TextureChange};
use lodestream_daemon::SessionSettings;
use lodestream_render::{Headless, SceneView};

use crate::static_host::host::Host;
use crate::static_host::publish_in;
use crate::support::daemon::{Server, Transport};
use crate::support::picture::{Picture, comparison, draw, headless, same};
use crate::support::scene::{TestScene, prepare_all};
use crate::support::shapes::{write_plate, write_wall};
use crate::support::viewer::{Viewer, config};

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

#[test]
fn tiles_come_from_every_source_once_and_look_alike() {
    let Some(mut headless) = headless() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = write_plate(folder.path());
    let name = publish_in(folder.path(), &path);
    let scene = of_files(&[path]).unwrap();
    let scene = TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")));
    let expected = draw(&mut headless, scene.whole());
    let server = Server::start(scene.source(), SessionSettings::default());
    let host = Host::start(&folder.path().join("host"));
    let file = format!("file:{}", folder.path().join("host").join(&name).display()).parse().unwrap();
    let addresses = [
        server.address(Transport::Quic),
        server.address(Transport::WebSocket),
        host.url(&name).parse().unwrap(),
        file,
    ];
    for address in addresses {
        let mut viewer = Viewer::start(&address, config());
        let stats = viewer.settle().stats;
        assert_eq!((stats.decode_failures, stats.refused), (0, 0), "{address}");
        let images = viewer.changes.iter().filter_map(|change| match change {
            Change::Texture(TextureChange { texture, level, tile, .. }) => Some((*texture, *level, *tile)),
            _ => None,
        });
        let images: Vec<_> = images.collect();
        // The finest level of 300² texels has four tiles, of normals and of surfaces.
        assert_eq!(images.iter().filter(|(.., tile)| tile.is_some()).count(), 8, "{address}: {images:?}");
        assert_eq!(images.iter().collect::<BTreeSet<_>>().len(), images.len(), "{address}: {images:?}");
        let found = comparison(&draw(&mut headless, viewer.changes), &expected);
        assert!(same(&found), "{address}: {found:?}");
    }
}
