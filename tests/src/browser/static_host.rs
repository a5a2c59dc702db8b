//! A published scene in a tab, from a web server for files.

use lodestream_preview::{PreviewError, encode};
use lodestream_report::image_error::image_error;
use lodestream_scene::blob::BlobId;
use lodestream_server::catalogue::publish::{Published, publish_page};
use lodestream_store::Objects;

use super::page::{MAX_FLIP, STATS, settle};
use super::{built_page, image, tab};
use crate::static_host::host::{Fault, Host};
use crate::static_host::published;
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

#[test]
fn a_tab_says_what_is_wrong_with_a_host() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let pages = Host::start(published());
    let page = with_page();
    for (fault, says) in [
        (Fault::NoRanges, "does not answer range requests"),
        (Fault::NoCors, "cannot be fetched"),
        (Fault::HangUp, "cannot be fetched"),
    ] {
        let host = Host::start(published()).with(fault);
        tab.navigate("about:blank");
        tab.navigate(&format!("{}#scene={}", pages.url(&page), host.url("small.lss")));
        let told =
            |stats: &serde_json::Value| stats["message"].as_str().is_some_and(|why| why.contains(says));
        let stats = tab.wait("the fault is told", STATS, told);
        assert_eq!(stats["settled"], false, "{fault:?}: {stats}");
    }
}
