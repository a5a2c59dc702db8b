//! What a window manager says to a window, on X servers that have none.

use std::time::{Duration, Instant};

use x11rb::connection::Connection as _;
use x11rb::protocol::xproto::{AtomEnum, ClientMessageEvent, ConnectionExt as _, EventMask};

/// Waits for a window on a display that can be asked to close, and asks it (WM_DELETE_WINDOW, ICCCM 4.2.8.1).
pub(crate) fn ask_to_close(display: &str, limit: Duration) {
    let (connection, screen) = x11rb::connect(Some(display)).unwrap();
    let root = connection.setup().roots[screen].root;
    let atom = |name: &[u8]| connection.intern_atom(false, name).unwrap().reply().unwrap().atom;
    let (protocols, delete) = (atom(b"WM_PROTOCOLS"), atom(b"WM_DELETE_WINDOW"));
    let listens = |window: u32| {
        let asked = connection.get_property(false, window, protocols, AtomEnum::ATOM, 0, 16).unwrap();
        // A window that is gone meanwhile has none.
        let spoken = asked.reply().ok().and_then(|reply| Some(reply.value32()?.any(|atom| atom == delete)));
        spoken.unwrap_or(false)
    };
    let until = Instant::now() + limit;
    let window = loop {
        let windows = connection.query_tree(root).unwrap().reply().unwrap().children;
        if let Some(window) = windows.into_iter().find(|window| listens(*window)) {
            break window;
        }
        assert!(Instant::now() < until, "no window was opened");
        std::thread::sleep(Duration::from_millis(20));
    };
    let message = ClientMessageEvent::new(32, window, protocols, [delete, x11rb::CURRENT_TIME, 0, 0, 0]);
    connection.send_event(false, window, EventMask::NO_EVENT, message).unwrap().check().unwrap();
}
