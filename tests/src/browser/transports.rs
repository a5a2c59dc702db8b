//! WebTransport raced against WebSocket, and silent UDP.

use std::net::{Ipv4Addr, UdpSocket};

use serde_json::json;

use super::devtools::{Tab, WEBGL};
use super::files::Files;
use super::npm::{serve_for, websocket};
use super::page::{script, serve, settle};
use super::{built_package, tab, tab_with};
use crate::support::PICTURE_PX;
use crate::support::scene::TestScene;

/// Opens a link from the page's thread, where the head start of WebTransport ends at once or never, so that the race does
/// not depend on speed; returns which transport opened, or why none did. `port`: the UDP port, by default the daemon's.
fn opened(tab: &mut Tab, port: Option<u16>, ends_at_once: bool) -> String {
    let (link, port) = (script("link"), json!(port));
    let name = tab.evaluate(&format!(
        "(async () => {{
            const {{ openLink }} = await import('/{link}');
            const {{ webtransport: offer }} = JSON.parse(document.getElementById('lodestream-server').textContent);
            const webTransport = {{
                url: `https://${{location.hostname}}:${{{port} ?? offer.port}}${{offer.path}}`,
                hashes: offer.certificate_hashes,
            }};
            const webSocket = `ws://${{location.host}}/`;
            const wait = globalThis.setTimeout;
            let headStarts = 0;
            globalThis.setTimeout = (act, ms, ...rest) => {{
                if (ms !== 200) return wait(act, ms, ...rest);
                headStarts += 1;
                if ({ends_at_once}) queueMicrotask(act);
                return 0;
            }};
            const name = await new Promise((done) => {{
                const close = openLink({{ webSocket, webTransport, only: null, resumes: false }}, {{
                    open: ({{ name }}) => {{ done(name); close(); }},
                    data() {{}},
                    lost: done,
                }});
            }});
            globalThis.setTimeout = wait;
            return headStarts === 1 ? name : `${{headStarts}} head starts`;
        }})()"
    ));
    name.as_str().unwrap().to_owned()
}

#[test]
fn webtransport_wins_within_its_head_start_and_websocket_where_udp_is_blocked() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let server = serve(TestScene::small());
    let stats = settle(&mut tab, &server.page_url());
    println!("by default: {}", stats["transport"]);
    // Which of both is faster depends on the machine, but not who wins while the other has not begun.
    assert_eq!(opened(&mut tab, None, false), "webtransport");
    let silent = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    assert_eq!(opened(&mut tab, Some(silent.local_addr().unwrap().port()), true), "ws");
    // A port that refuses ends the head start.
    let refused = silent.local_addr().unwrap().port();
    drop(silent);
    assert_eq!(opened(&mut tab, Some(refused), false), "ws");
    server.assert_healthy();
}

const PAGE: &str = r#"<!doctype html>
<script type="module">
  import { connect } from './connect.js';
  const asked = new URLSearchParams(location.search);
  const webTransport = { url: `https://127.0.0.1:${asked.get('udp')}/`, hashes: ['00'.repeat(32)] };
  window.connection = connect(asked.get('src'), { webTransport, width: 640, height: 360 });
</script>"#;

#[test]
fn a_page_settles_over_websocket_where_udp_is_silent() {
    let Some(mut tab) = tab_with(PICTURE_PX, WEBGL) else { return };
    let site = Files::start(built_package(), PAGE.to_owned());
    let server = serve_for(TestScene::small(), &site);
    let silent = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = silent.local_addr().unwrap().port();
    tab.navigate(&format!("{}/page.html?src={}&udp={port}", site.origin(), websocket(&server)));
    let stats =
        tab.wait("the page settles", "window.connection?.stats() ?? {}", |stats| stats["settled"] == true);
    assert_eq!((&stats["transport"], &stats["connections"]), (&json!("ws"), &json!(1)), "{stats}");
    silent.set_nonblocking(true).unwrap();
    assert!(silent.recv(&mut [0; 2048]).is_ok(), "WebTransport was tried");
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}
