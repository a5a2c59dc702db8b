//! What keys do.

/// What a key does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::window) enum Action {
    /// The start view.
    Start,
    /// The view from the front.
    Front,
    /// The view from the right.
    Right,
    /// The view from above.
    Top,
    /// Orthographic or perspective projection.
    Orthographic,
    /// Frames what is under the pointer.
    Frame,
    /// Flight or orbit.
    Fly,
    /// Starts or stops the turntable.
    Turntable,
    /// Moves forward while it is held, as do the next five in their directions.
    MoveForward,
    /// Moves back.
    MoveBack,
    /// Moves left.
    MoveLeft,
    /// Moves right.
    MoveRight,
    /// Moves up.
    MoveUp,
    /// Moves down.
    MoveDown,
    /// Moves faster while it is held.
    MoveFast,
    /// Measures between points that are clicked.
    Measure,
    /// Cuts the scene by a plane.
    Section,
    /// Draws the edges of triangles.
    Wireframe,
    /// Plays or pauses the animation.
    Play,
    /// Plays the clip before.
    PreviousClip,
    /// Plays the next clip.
    NextClip,
    /// Shows the list of parts.
    Parts,
    /// Hides the selected part.
    HidePart,
    /// Draws the selected part alone.
    IsolatePart,
    /// Moves the camera to the selected part.
    GoToPart,
    /// Draws all parts again.
    ShowAll,
    /// Shows figures about scene and stream.
    Information,
    /// Shows what keys do.
    Help,
    /// Shows settings of the picture.
    Settings,
    /// Hides and shows all text.
    Overlay,
    /// Opens a file.
    Open,
    /// Writes the picture into a file.
    Picture,
    /// Enters or leaves full screen.
    FullScreen,
    /// Ends measuring, closes the panel, leaves full screen: the first that applies.
    Leave,
    /// Closes the window.
    Quit,
}

/// An action for people: its name in settings files, the group under which help has it, what it does, its usual keys.
#[derive(Clone, Copy, Debug)]
pub(in crate::window) struct ActionEntry {
    pub(in crate::window) action: Action,
    pub(in crate::window) name: &'static str,
    pub(in crate::window) group: &'static str,
    pub(in crate::window) what: &'static str,
    pub(super) keys: &'static [&'static str],
}

const fn entry(
    action: Action,
    [name, group, what]: [&'static str; 3],
    keys: &'static [&'static str],
) -> ActionEntry {
    ActionEntry { action, name, group, what, keys }
}

/// All actions, by groups.
pub(in crate::window) const ACTIONS: &[ActionEntry] = &[
    entry(Action::Start, ["start", "view", "start view"], &["0", "Home", "R"]),
    entry(Action::Front, ["front", "view", "from the front"], &["1"]),
    entry(Action::Right, ["right", "view", "from the right"], &["3"]),
    entry(Action::Top, ["top", "view", "from above"], &["7"]),
    entry(Action::Orthographic, ["orthographic", "view", "orthographic, perspective"], &["O"]),
    entry(Action::Frame, ["frame", "view", "frame what is under the pointer"], &["F"]),
    entry(Action::Fly, ["fly", "view", "fly, orbit"], &["V"]),
    entry(Action::Turntable, ["turntable", "view", "turntable"], &["Space"]),
    entry(Action::MoveForward, ["move-forward", "move", "forward"], &["W"]),
    entry(Action::MoveBack, ["move-back", "move", "back"], &["S"]),
    entry(Action::MoveLeft, ["move-left", "move", "left"], &["A"]),
    entry(Action::MoveRight, ["move-right", "move", "right"], &["D"]),
    entry(Action::MoveUp, ["move-up", "move", "up"], &["E"]),
    entry(Action::MoveDown, ["move-down", "move", "down"], &["Q"]),
    entry(Action::MoveFast, ["move-fast", "move", "four times as fast"], &["Shift"]),
    entry(Action::Measure, ["measure", "look", "measure between clicks"], &["M"]),
    entry(Action::Section, ["section", "look", "section plane"], &["C"]),
    entry(Action::Wireframe, ["wireframe", "look", "edges of triangles"], &["T"]),
    entry(Action::Play, ["play", "animation", "play, pause"], &["K"]),
    entry(Action::PreviousClip, ["previous-clip", "animation", "clip before"], &["Comma"]),
    entry(Action::NextClip, ["next-clip", "animation", "next clip"], &["Period"]),
    entry(Action::Parts, ["parts", "parts", "list of parts"], &["P"]),
    entry(Action::HidePart, ["hide-part", "parts", "hide the selected part"], &["X"]),
    entry(Action::IsolatePart, ["isolate-part", "parts", "draw it alone"], &["L"]),
    entry(Action::GoToPart, ["go-to-part", "parts", "go to it"], &["Z"]),
    entry(Action::ShowAll, ["show-all", "parts", "show all parts"], &["U"]),
    entry(Action::Information, ["information", "window", "information"], &["I"]),
    entry(Action::Help, ["help", "window", "this help"], &["H"]),
    entry(Action::Settings, ["settings", "window", "settings of the picture"], &["G"]),
    entry(Action::Overlay, ["overlay", "window", "hide all text"], &["Ctrl+H"]),
    entry(Action::Open, ["open", "window", "open a file"], &["Ctrl+O"]),
    entry(Action::Picture, ["picture", "window", "write the picture"], &["F12", "Ctrl+S"]),
    entry(Action::FullScreen, ["full-screen", "window", "full screen"], &["F11"]),
    entry(Action::Leave, ["leave", "window", "end measuring, close, leave"], &["Escape"]),
    entry(Action::Quit, ["quit", "window", "quit"], &["Ctrl+Q"]),
];
