//! Window manager and user input on X servers without either, and screenshots.

use std::path::Path;
use std::time::{Duration, Instant};

use image::RgbImage;
use x11rb::connection::Connection as _;
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    AtomEnum, BUTTON_PRESS_EVENT, BUTTON_RELEASE_EVENT, ChangeWindowAttributesAux, ClientMessageEvent,
    ConnectionExt as _, EventMask, ImageFormat, InputFocus, KEY_PRESS_EVENT, KEY_RELEASE_EVENT,
    MOTION_NOTIFY_EVENT,
};
use x11rb::protocol::xtest::ConnectionExt as _;
use x11rb::rust_connection::RustConnection;

use super::drag_and_drop::drop_files;

/// Keysyms: the left control and shift keys, Home, Escape, F11 and F12.
const CONTROL: u32 = 0xffe3;
pub(crate) const SHIFT: u32 = 0xffe1;
pub(crate) const HOME: u32 = 0xff50;
pub(crate) const ESCAPE: u32 = 0xff1b;
pub(crate) const F11: u32 = 0xffc8;
pub(crate) const F12: u32 = 0xffc9;

/// A program's window on a display.
pub(crate) struct OpenWindow {
    connection: RustConnection,
    display: String,
    root: u32,
    window: u32,
    protocols: u32,
    delete: u32,
}

impl OpenWindow {
    /// Waits for a window with WM_DELETE_WINDOW (ICCCM 4.2.8.1).
    pub(crate) fn wait(display: &str, limit: Duration) -> Self {
        let (connection, screen) = x11rb::connect(Some(display)).unwrap();
        let root = connection.setup().roots[screen].root;
        let atom = |name: &[u8]| connection.intern_atom(false, name).unwrap().reply().unwrap().atom;
        let (protocols, delete) = (atom(b"WM_PROTOCOLS"), atom(b"WM_DELETE_WINDOW"));
        let listens = |window: u32| {
            let asked = connection.get_property(false, window, protocols, AtomEnum::ATOM, 0, 16).unwrap();
            // A window that has been destroyed has no properties.
            let spoken =
                asked.reply().ok().and_then(|reply| Some(reply.value32()?.any(|atom| atom == delete)));
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
        let this = Self { connection, display: display.to_owned(), root, window, protocols, delete };
        // Long before the first key: one that comes with the focus is lost.
        this.focus();
        this
    }

    /// Sends WM_DELETE_WINDOW.
    pub(crate) fn ask_to_close(&self) {
        let data = [self.delete, x11rb::CURRENT_TIME, 0, 0, 0];
        let message = ClientMessageEvent::new(32, self.window, self.protocols, data);
        let sent = self.connection.send_event(false, self.window, EventMask::NO_EVENT, message);
        sent.unwrap().check().unwrap();
    }

    /// Moves the pointer on the screen; the window is in its corner.
    pub(crate) fn point_at(&self, x: i16, y: i16) {
        self.fake(MOTION_NOTIFY_EVENT, 0, x, y);
    }

    /// Turns the wheel by a line, nearer or away.
    pub(crate) fn turn_wheel(&self, nearer: bool) {
        let button = if nearer { 4 } else { 5 };
        self.fake(BUTTON_PRESS_EVENT, button, 0, 0);
        self.fake(BUTTON_RELEASE_EVENT, button, 0, 0);
    }

    /// Does what is given and waits until the window asks the window manager to make it fill the screen, or no longer
    /// (`_NET_WM_STATE`, EWMH).
    pub(crate) fn wait_for_full_screen(&self, limit: Duration, act: impl FnOnce()) {
        let (connection, _) = x11rb::connect(Some(&self.display)).unwrap();
        let listens = ChangeWindowAttributesAux::new().event_mask(EventMask::SUBSTRUCTURE_NOTIFY);
        connection.change_window_attributes(self.root, &listens).unwrap().check().unwrap();
        let atom = |name: &[u8]| connection.intern_atom(false, name).unwrap().reply().unwrap().atom;
        let (state, whole) = (atom(b"_NET_WM_STATE"), atom(b"_NET_WM_STATE_FULLSCREEN"));
        act();
        let until = Instant::now() + limit;
        loop {
            match connection.poll_for_event().unwrap() {
                Some(Event::ClientMessage(message))
                    if message.type_ == state && message.data.as_data32()[1] == whole =>
                {
                    return;
                }
                Some(_) => {}
                None => {
                    assert!(Instant::now() < until, "the window does not ask");
                    std::thread::sleep(Duration::from_millis(10));
                }
            }
        }
    }

    /// Presses the left button where the pointer is, and holds it.
    pub(crate) fn hold_left(&self) {
        self.fake(BUTTON_PRESS_EVENT, 1, 0, 0);
    }

    /// Clicks with the left button.
    pub(crate) fn click(&self, x: i16, y: i16) {
        self.drag([x, y], [x, y]);
    }

    /// Drags with the left button, in one step.
    pub(crate) fn drag(&self, from: [i16; 2], to: [i16; 2]) {
        self.point_at(from[0], from[1]);
        self.hold_left();
        if from != to {
            self.point_at(to[0], to[1]);
        }
        self.fake(BUTTON_RELEASE_EVENT, 1, 0, 0);
    }

    /// Drops files on the middle of a window of this size.
    pub(crate) fn drop_files(&self, [width, height]: [u32; 2], files: &[&Path], limit: Duration) {
        let middle = [width, height].map(|side| u16::try_from(side / 2).unwrap());
        drop_files(&self.display, self.window, middle, files, limit);
    }

    /// Presses and releases the key of a letter with a control key.
    pub(crate) fn press_with_control(&self, letter: char) {
        self.focus();
        self.fake(KEY_PRESS_EVENT, self.code_of(CONTROL), 0, 0);
        self.press(letter);
        self.fake(KEY_RELEASE_EVENT, self.code_of(CONTROL), 0, 0);
    }

    /// Presses and releases the key of a letter, a digit or a space.
    pub(crate) fn press(&self, letter: char) {
        // The keysyms of Latin letters are their characters.
        self.press_symbol(u32::from(letter.to_ascii_lowercase()));
    }

    /// Presses and releases the key of a keysym.
    pub(crate) fn press_symbol(&self, symbol: u32) {
        let code = self.code_of(symbol);
        self.focus();
        for kind in [KEY_PRESS_EVENT, KEY_RELEASE_EVENT] {
            self.fake(kind, code, 0, 0);
        }
    }

    /// Holds the key of a letter while something is done.
    pub(crate) fn hold<T>(&self, letter: char, act: impl FnOnce() -> T) -> T {
        self.hold_symbol(u32::from(letter), act)
    }

    /// Holds the key of a keysym while something is done.
    pub(crate) fn hold_symbol<T>(&self, symbol: u32, act: impl FnOnce() -> T) -> T {
        let code = self.code_of(symbol);
        self.focus();
        self.fake(KEY_PRESS_EVENT, code, 0, 0);
        let done = act();
        self.fake(KEY_RELEASE_EVENT, code, 0, 0);
        done
    }

    fn focus(&self) {
        let focus = self.connection.set_input_focus(InputFocus::PARENT, self.window, x11rb::CURRENT_TIME);
        focus.unwrap().check().unwrap();
    }

    /// The code of the key of a keysym.
    fn code_of(&self, symbol: u32) -> u8 {
        let (first, last) = (self.connection.setup().min_keycode, self.connection.setup().max_keycode);
        let asked = self.connection.get_keyboard_mapping(first, last - first + 1).unwrap();
        let mapping = asked.reply().unwrap();
        let mut keys = mapping.keysyms.chunks(usize::from(mapping.keysyms_per_keycode));
        let key = keys.position(|symbols| symbols[0] == symbol).expect("a keyboard with this key");
        first + u8::try_from(key).unwrap()
    }

    fn fake(&self, kind: u8, detail: u8, x: i16, y: i16) {
        let done = self.connection.xtest_fake_input(kind, detail, x11rb::CURRENT_TIME, self.root, x, y, 0);
        done.unwrap().check().unwrap();
    }

    /// A screenshot of the window.
    pub(crate) fn picture(&self, [width, height]: [u32; 2]) -> RgbImage {
        let side = |px: u32| u16::try_from(px).unwrap();
        let asked = self.connection.get_image(
            ImageFormat::Z_PIXMAP,
            self.root,
            0,
            0,
            side(width),
            side(height),
            u32::MAX,
        );
        // Four bytes per pixel: blue, green, red, unused.
        let data = asked.unwrap().reply().unwrap().data;
        assert_eq!(data.len(), (4 * width * height) as usize, "another depth than 24");
        RgbImage::from_fn(width, height, |x, y| {
            let at = 4 * (y * width + x) as usize;
            image::Rgb([data[at + 2], data[at + 1], data[at]])
        })
    }
}
