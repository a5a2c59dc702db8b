//! Drag and drop between windows of X servers (XDND 5), the source's side.

use std::path::Path;
use std::time::{Duration, Instant};

use x11rb::connection::Connection as _;
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    ClientMessageEvent, ConnectionExt as _, CreateWindowAux, EventMask, PropMode, SELECTION_NOTIFY_EVENT,
    SelectionNotifyEvent, WindowClass,
};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

/// Version of the protocol.
const VERSION: u32 = 5;

/// Drops files on a window at a place of the screen, as a file manager does.
///
/// # Panics
/// The window does not take them within `limit`.
pub(crate) fn drop_files(display: &str, target: u32, [x, y]: [u16; 2], files: &[&Path], limit: Duration) {
    let (connection, screen) = x11rb::connect(Some(display)).unwrap();
    let root = connection.setup().roots[screen].root;
    let atom = |name: &str| connection.intern_atom(false, name.as_bytes()).unwrap().reply().unwrap().atom;
    let [enter, position, status, drop, finished, selection] =
        ["XdndEnter", "XdndPosition", "XdndStatus", "XdndDrop", "XdndFinished", "XdndSelection"].map(atom);
    let (list, copy) = (atom("text/uri-list"), atom("XdndActionCopy"));
    let source = connection.generate_id().unwrap();
    let (class, aux) = (WindowClass::INPUT_OUTPUT, CreateWindowAux::new());
    connection.create_window(0, source, root, 0, 0, 1, 1, 0, class, 0, &aux).unwrap().check().unwrap();
    connection.set_selection_owner(source, selection, x11rb::CURRENT_TIME).unwrap().check().unwrap();
    let send = |kind: u32, data: [u32; 5]| {
        let message = ClientMessageEvent::new(32, target, kind, data);
        connection.send_event(false, target, EventMask::NO_EVENT, message).unwrap().check().unwrap();
    };
    let uris: String = files.iter().map(|file| format!("file://{}\r\n", file.display())).collect();
    let until = Instant::now() + limit;
    send(enter, [source, VERSION << 24, list, 0, 0]);
    send(position, [source, 0, u32::from(x) << 16 | u32::from(y), x11rb::CURRENT_TIME, copy]);
    assert!(wait(&connection, until, status, &uris, list), "the window takes no files");
    send(drop, [source, 0, x11rb::CURRENT_TIME, 0, 0]);
    assert!(wait(&connection, until, finished, &uris, list), "the window took no files");
}

/// Answers requests for the files until a message of this kind comes; returns whether it says yes.
fn wait(connection: &RustConnection, until: Instant, kind: u32, uris: &str, list: u32) -> bool {
    loop {
        match connection.poll_for_event().unwrap() {
            Some(Event::SelectionRequest(asked)) => {
                let data = uris.as_bytes();
                connection
                    .change_property8(PropMode::REPLACE, asked.requestor, asked.property, list, data)
                    .unwrap();
                let answer = SelectionNotifyEvent {
                    response_type: SELECTION_NOTIFY_EVENT,
                    sequence: 0,
                    time: asked.time,
                    requestor: asked.requestor,
                    selection: asked.selection,
                    target: asked.target,
                    property: asked.property,
                };
                let sent = connection.send_event(false, asked.requestor, EventMask::NO_EVENT, answer);
                sent.unwrap().check().unwrap();
            }
            Some(Event::ClientMessage(message)) if message.type_ == kind => {
                return message.data.as_data32()[1] & 1 == 1;
            }
            Some(_) => {}
            None => {
                assert!(Instant::now() < until, "no answer of the window");
                std::thread::sleep(Duration::from_millis(10));
            }
        }
    }
}
