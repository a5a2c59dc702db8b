//! Several servers over one store behind a load balancer are one server to viewers.

use std::io::copy;
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use lodestream_bake::scene::of_files;
use lodestream_client::core::Change;
use lodestream_daemon::SessionSettings;
use lodestream_protocol::source::SceneSource;
use lodestream_server::catalogue::publish::publish;
use lodestream_store::{BlobCache, Objects, SceneStore};

use crate::support::daemon::{Server, Transport};
use crate::support::scene::options;
use crate::support::shapes::write_scene;
use crate::support::viewer::{Viewer, config};

/// A load balancer: passes TCP connections to servers in turn, skipping those that refuse.
fn balance(servers: [SocketAddr; 2]) -> (SocketAddr, Arc<Mutex<Vec<SocketAddr>>>) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let address = listener.local_addr().unwrap();
    let (turn, chosen) = (AtomicUsize::new(0), Arc::new(Mutex::new(Vec::new())));
    let noted = Arc::clone(&chosen);
    std::thread::spawn(move || {
        while let Ok((client, _)) = listener.accept() {
            let first = turn.fetch_add(1, Ordering::Relaxed);
            let in_turn = [servers[first % 2], servers[(first + 1) % 2]];
            let Some(server) = in_turn.into_iter().find_map(|server| TcpStream::connect(server).ok()) else {
                continue;
            };
            noted.lock().unwrap().push(server.peer_addr().unwrap());
            let both =
                [(&client, &server), (&server, &client)].map(|(from, to)| (from.try_clone(), to.try_clone()));
            for (from, to) in both {
                let (mut from, mut to) = (from.unwrap(), to.unwrap());
                std::thread::spawn(move || {
                    let _ = copy(&mut from, &mut to);
                    // The end of one direction ends both.
                    let _ = (from.shutdown(Shutdown::Both), to.shutdown(Shutdown::Both));
                });
            }
        }
    });
    (address, chosen)
}

/// A server over the store that shares no memory with the others.
fn server(objects: &Objects, runtime: &tokio::runtime::Runtime, rate_bits_per_s: Option<u64>) -> Server {
    let cache = BlobCache::new(1 << 26);
    let scene = runtime.block_on(SceneStore::open(objects, "scene.lss", &cache)).unwrap();
    let scene: Arc<dyn SceneSource> = Arc::new(scene);
    Server::start(scene, SessionSettings { rate_bits_per_s, ..SessionSettings::default() })
}

#[test]
fn two_servers_over_one_store_and_a_balancer_are_one_server() {
    let folder = tempfile::tempdir().unwrap();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let mut scene = of_files(&[write_scene(folder.path())]).unwrap();
    scene.name = "scene".into();
    let bucket = folder.path().join("bucket");
    std::fs::create_dir(&bucket).unwrap();
    let objects = Objects::of_folder(&bucket).unwrap();
    runtime.block_on(publish(&scene, &objects, &folder.path().join("cache"), &options())).unwrap();

    let slow = Some(100_000);
    let servers = [server(&objects, &runtime, slow), server(&objects, &runtime, None)];
    let (balancer, chosen) = balance(servers.each_ref().map(Server::http_address));
    let address = format!("ws://{balancer}/scene").parse().unwrap();
    let mut viewer = Viewer::start(&address, config());
    let before = viewer.wait("chunks", |status| status.stats.applied_chunks >= 10).stats;
    assert!(!before.settled, "the first server must end before the viewer has settled");
    let [first, second] = servers;
    first.kill();
    let after = viewer.settle().stats;
    let went = chosen.lock().unwrap().clone();
    assert_eq!(went.last(), Some(&second.http_address()), "{went:?}");
    assert!(after.connections >= 2 && after.decode_failures == 0, "{after:?}");
    // For the viewer it was one scene: nothing was discarded or sent again but descriptions and part of a blob.
    let scenes = viewer.changes.iter().filter(|change| matches!(change, Change::Scene(_))).count();
    assert_eq!(scenes, 1);
    let mut direct = Viewer::start(&second.address(Transport::WebSocket), config());
    let alone = direct.settle().stats;
    assert_eq!(after.faces, alone.faces);
    let again = 6_000;
    assert!(
        after.transport_bytes <= alone.transport_bytes + again,
        "{} bytes where one server sends {}",
        after.transport_bytes,
        alone.transport_bytes
    );
    second.assert_healthy();
}
