//! A published scene in a tab, from a web server for files.

use lodestream_preview::{PreviewError, encode};
use lodestream_report::image_error::image_error;
use lodestream_scene::blob::BlobId;
use lodestream_server::catalogue::publish::{Published, publish_page};
use lodestream_store::Objects;
use serde_json::Value;

use super::devtools::Tab;
use super::page::{MAX_FLIP, STATS, settle};
use super::{built_page, image, tab};
use crate::static_host::host::{Fault, Host};
use crate::static_host::{copy, packs, published};
use crate::support::PICTURE_PX;
use crate::support::picture::{Picture, draw, headless, keep};
use crate::support::scene::TestScene;

/// The published scene with the page; returns the page's name.
fn with_page() -> String {
    let page = lodestream_daemon::Page::load(&built_page()).unwrap();
    let objects = Objects::of_folder(published()).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let source = TestScene::small().source();
    let pages: Vec<_> = (0..).map_while(|page| source.page(page)).collect();
    let read =
        |asset, part| Ok::<_, PreviewError>(source.read(&BlobId::Asset { asset, part }).ok().map(Into::into));
    let preview = encode(source.header(), &pages, read).ok();
    assert!(preview.is_some(), "the scene has a preview");
    let published = Published { name: "small.lss".into(), preview, ..Published::default() };
    runtime.block_on(publish_page(&page, &published, &objects)).unwrap()
}

#[test]
fn a_published_page_shows_what_the_native_viewer_shows() {
    let (Some(mut tab), Some(mut headless)) = (tab(PICTURE_PX), headless()) else { return };
    let host = Host::start(published());
    let page = with_page();
    let stats = settle(&mut tab, &host.url(&page));
    assert_eq!(stats["transport"], "http", "{stats}");
    assert_eq!([&stats["decode_failures"], &stats["lacking_blobs"]], [0, 0], "{stats}");
    let native = draw(&mut headless, TestScene::small().whole());
    let shown =
        Picture { image: image(&mut tab, "lodestream.view.picture()"), covered: native.covered.clone() };
    keep(&shown, "tab-static-host");
    let flip = image_error(&shown.image, &native.image).unwrap().flip;
    assert!(flip <= MAX_FLIP, "{flip}: {stats}");
    let named = tab.evaluate("JSON.parse(document.getElementById('lodestream-server').textContent).preview");
    let file = tab.evaluate(&format!("fetch({named}).then((answer) => answer.status)"));
    assert_eq!(file, 200, "{named}");
    // A page of another origin reads it too, without the header that shows ranges.
    let pages = Host::start(published());
    tab.navigate("about:blank");
    let elsewhere = settle(&mut tab, &format!("{}#scene={}", pages.url(&page), host.url("small.lss")));
    assert_eq!(elsewhere["lacking_blobs"], 0, "{elsewhere}");
    assert_eq!(tab.console, Vec::<String>::new());
    assert!(pages.requests().iter().all(|path| !path.ends_with(".lsp")), "{:?}", pages.requests());
}

/// Waits until the page states a fault, which it goes on after; returns the figures.
fn told(tab: &mut Tab, what: &str, address: &str, says: &[&str]) -> Value {
    tab.navigate("about:blank");
    tab.navigate(address);
    let told = |stats: &Value| {
        let why = stats["message"].as_str();
        why.is_some_and(|why| says.iter().all(|part| why.contains(part)))
    };
    let stats = tab.wait(&format!("{what} is told"), STATS, told);
    println!("{what}: {}", stats["message"]);
    assert_eq!(stats["settled"], false, "{what}: {stats}");
    // Its thread answers.
    tab.evaluate("new Promise((done) => setTimeout(done))");
    stats
}

/// Checks that streaming has ended and the page shows why.
fn ended(tab: &mut Tab, what: &str, says: &[&str]) {
    let shown = "document.getElementById('message')?.textContent ?? ''";
    let holds =
        |shown: &Value| says.iter().all(|part| shown.as_str().is_some_and(|text| text.contains(part)));
    tab.wait(&format!("{what} is shown"), shown, holds);
}

#[test]
fn a_tab_says_what_is_wrong_with_a_host() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let pages = Host::start(published());
    let page = with_page();
    let at = |host: &Host| format!("{}#scene={}", pages.url(&page), host.url("small.lss"));
    for (fault, says, ends) in [
        (
            Fault::NoRanges,
            "the published scene: the server does not answer range requests; use a server that does",
            true,
        ),
        (Fault::NoCors, "the published scene: it cannot be fetched", false),
        (Fault::HangUp, "the published scene: it cannot be fetched", false),
        (Fault::Short, "the published scene: it cannot be fetched", false),
        // Other origins do not show which range they sent, so only the bytes tell.
        (Fault::OtherRange, "the published scene: it is not a published scene", true),
    ] {
        let host = Host::start(published()).with(fault);
        told(&mut tab, &format!("{fault:?}"), &at(&host), &[says]);
        if ends {
            ended(&mut tab, &format!("{fault:?}"), &[says]);
        }
    }
    // From the page's own origin the header shows it.
    for (fault, says) in [
        (Fault::OtherRange, "the published scene: the server sent another range than it was asked for"),
        (Fault::Short, "the published scene: it cannot be fetched"),
    ] {
        let host = Host::start(published()).with(fault);
        told(&mut tab, &format!("{fault:?} of the same origin"), &host.url(&page), &[says]);
    }
}

#[test]
fn a_tab_says_what_is_wrong_with_a_published_scene() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let pages = Host::start(published());
    let page = with_page();
    let whole = std::fs::read(published().join("small.lss")).unwrap();
    let mut damaged = whole.clone();
    damaged[60] ^= 1;
    for (what, bytes, says) in [
        ("missing", None, "the published scene: it is not there (status 404); publish the scene again"),
        ("truncated", Some(&whole[..whole.len() / 2]), "it is truncated"),
        ("another file", Some(&b"<html>moved</html>"[..]), "not a published scene"),
        ("damaged", Some(&damaged[..]), "the hash of its opening does not match"),
    ] {
        let folder = copy();
        let path = folder.path().join("small.lss");
        match bytes {
            Some(bytes) => std::fs::write(path, bytes).unwrap(),
            None => std::fs::remove_file(path).unwrap(),
        }
        let host = Host::start(folder.path());
        told(&mut tab, what, &format!("{}#scene={}", pages.url(&page), host.url("small.lss")), &[says]);
        ended(&mut tab, what, &[says]);
    }
}

#[test]
fn a_tab_says_what_is_wrong_with_a_pack_and_shows_the_rest() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let pages = Host::start(published());
    let page = with_page();
    let largest =
        packs().into_iter().max_by_key(|name| std::fs::metadata(published().join(name)).unwrap().len());
    let name = largest.unwrap();
    for (what, says) in [
        ("missing", "it is not there (status 404)"),
        ("truncated", "truncated"),
        ("changed", "do not have their hash"),
    ] {
        let folder = copy();
        let path = folder.path().join(&name);
        let mut bytes = std::fs::read(&path).unwrap();
        match what {
            "missing" => std::fs::remove_file(&path).unwrap(),
            "truncated" => std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap(),
            _ => {
                bytes.iter_mut().step_by(50).for_each(|byte| *byte ^= 4);
                std::fs::write(&path, &bytes).unwrap();
            }
        }
        let host = Host::start(folder.path());
        let address = format!("{}#scene={}", pages.url(&page), host.url("small.lss"));
        told(&mut tab, &format!("a {what} pack"), &address, &[&name, says]);
        let stats = tab.wait("the rest is shown", STATS, |stats| {
            stats["faces"].as_f64() > Some(0.0) && stats["frame_count"].as_f64() > Some(0.0)
        });
        assert_eq!(stats["decode_failures"], 0, "{what}: {stats}");
        // Put back, it is read.
        std::fs::copy(published().join(&name), &path).unwrap();
        let stats = tab.wait("all is shown", STATS, |stats| stats["settled"] == true);
        assert_eq!(stats["lacking_blobs"], 0, "{what}: {stats}");
    }
    // Wrong ranges in packs: of the page's origin the header shows it, of others the hashes do.
    let host = Host::start(published()).with(Fault::OtherRange).in_packs();
    told(&mut tab, "OtherRange in packs", &host.url(&page), &["packs/", "the server sent another range"]);
    host.set(None);
    tab.wait("all is shown", STATS, |stats| stats["settled"] == true);
    let host = Host::start(published()).with(Fault::OtherRange).in_packs();
    let address = format!("{}#scene={}", pages.url(&page), host.url("small.lss"));
    told(&mut tab, "OtherRange in packs elsewhere", &address, &["packs/", "do not have their hash"]);
    host.set(None);
    tab.wait("all is shown", STATS, |stats| stats["settled"] == true);
}
