//! Control messages: all that the peers exchange besides blobs.

use lodestream_scene::animation::{AnimationError, AnimationTable};
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::{Fingerprint, SceneError, SceneHeader, ScenePage};
use lodestream_scene::limits::{
    MAX_BLOB_BYTES, MAX_HAVE, MAX_IDS_PER_MESSAGE, MAX_NAME_BYTES, MAX_PAGES_PER_MESSAGE, MAX_REASON_BYTES,
    MAX_TOKEN_BYTES,
};
use lodestream_scene::parts::{PartTable, PartsError};
use lodestream_scene::punctual_lights::{PunctualLights, PunctualLightsError};
use lodestream_scene::view::{View, ViewError};

use crate::coding::{Decode, Encode, SceneValue, message_fields};

/// Protocol versions that this crate supports.
pub const VERSIONS: std::ops::RangeInclusive<u16> = 5..=5;

/// From client to server.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientMessage {
    /// Opens the session; first, once.
    Hello(Hello),
    /// Requests blobs or parts of them, or changes the priority of requested ones. Bytes already sent are not sent
    /// again, except after a `Cancel`.
    Want(Vec<Want>),
    /// Cancels requests. Bytes already passed to the transport still arrive. The server forgets that it sent these
    /// blobs, so a client also cancels the blobs that it evicts.
    Cancel(Vec<BlobId>),
    /// The view has changed; it orders what the server pushes.
    SetView(View),
    /// Requests pages of the scene description, to be sent before all else.
    WantScenePages(Vec<u32>),
    /// Grants access to the scene: sent before `Hello`, and again before the token expires. Servers without access
    /// control ignore it.
    Token(Token),
    /// Shows that the client is alive; answered by `Pong` at once.
    Ping(u32),
    /// The client leaves.
    Bye,
}

/// A client's first message.
#[derive(Clone, Debug, PartialEq)]
pub struct Hello {
    /// Lowest version that the client supports.
    pub version_min: u16,
    /// Highest version that the client supports.
    pub version_max: u16,
    /// Name of the scene; empty for the server's default.
    pub scene: String,
    /// The client's view; `None` for the scene's start view.
    pub view: Option<View>,
    /// Longest blob that the client accepts, in bytes.
    pub max_blob_bytes: u32,
    /// The client's memory for blobs, in bytes; the server pushes no more than this.
    pub budget_bytes: u64,
    /// Fingerprint of the scene that the blobs of `have` belong to.
    pub fingerprint: Fingerprint,
    /// Blobs that the client has from an earlier session; they are not pushed.
    pub have: Vec<BlobId>,
}

message_fields!(Hello {
    version_min,
    version_max,
    scene,
    view: SceneValue,
    max_blob_bytes,
    budget_bytes,
    fingerprint,
    have: SceneValue,
});

impl Hello {
    /// A `Hello` with this crate's versions for a scene (empty for the server's default): the start view, no blobs
    /// from an earlier session, no limit on blob length, and 1 GiB of memory.
    #[must_use]
    pub fn new(scene: impl Into<String>) -> Self {
        Self {
            version_min: *VERSIONS.start(),
            version_max: *VERSIONS.end(),
            scene: scene.into(),
            view: None,
            max_blob_bytes: MAX_BLOB_BYTES,
            budget_bytes: 1 << 30,
            fingerprint: [0; 16],
            have: Vec::new(),
        }
    }
}

/// A bearer token. Its `Debug` output does not show the text.
#[derive(Clone, PartialEq, Eq, Encode, Decode)]
pub struct Token(pub String);

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Token of {} bytes", self.0.len())
    }
}

/// One request: a blob, or the part of it from `offset` to `end`, and its priority.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Want {
    /// The blob.
    pub id: BlobId,
    /// Higher is sent first; see [`lodestream_select::Priority`].
    pub priority: u32,
    /// Start of the part: bytes that the client has. The run begins here, or later if the server has sent more. Below
    /// the blob's length.
    pub offset: u32,
    /// End of the part, above `offset` and at most the blob's length; `None` for the blob's end.
    pub end: Option<u32>,
}

message_fields!(Want { id: SceneValue, priority, offset, end });

impl Want {
    /// A request for a whole blob.
    #[must_use]
    pub const fn whole(id: BlobId, priority: u32) -> Self {
        Self { id, priority, offset: 0, end: None }
    }
}

/// From server to client.
#[derive(Clone, Debug, PartialEq)]
pub enum ServerMessage {
    /// Opens the session; first, once, possibly before `Hello` arrives.
    Welcome(Welcome),
    /// A page of the scene description.
    ScenePage(ScenePage),
    /// The scene's punctual lights: once, after `Welcome`, if there are any. Optional for clients.
    PunctualLights(PunctualLights),
    /// The scene has a table of what its parts are called: once, after `Welcome`. Clients request blobs of it only then.
    /// Optional for clients.
    Parts(PartTable),
    /// The scene has animated models: once, after `Welcome`. Clients request blobs of them only then. Optional for clients.
    Animations(AnimationTable),
    /// A requested blob will not be sent.
    Refused(Refused),
    /// Refusals of several blobs, 1 to [`MAX_IDS_PER_MESSAGE`].
    RefusedMany(Vec<Refused>),
    /// The base meshes of all visible instances, for the last known view, and their pages have been sent.
    /// Informative: on QUIC it may overtake blobs.
    BasesSent,
    /// Nothing is queued: all requested blobs have been sent.
    Done,
    /// Answers a `Ping`.
    Pong(u32),
    /// The server ends the session.
    Close(Close),
}

/// A server's first message.
#[derive(Clone, Debug, PartialEq)]
pub struct Welcome {
    /// The server's version. A client without it closes.
    pub version: u16,
    /// Number of the session, for logs.
    pub session: u64,
    /// The server's rate limit in bits per second; 0 for unlimited.
    pub rate_bits_per_s: u64,
    /// Time without a message after which the server closes, in milliseconds. The client pings well before that.
    pub idle_timeout_ms: u32,
    /// The scene.
    pub scene: SceneHeader,
}

message_fields!(Welcome { version, session, rate_bits_per_s, idle_timeout_ms, scene: SceneValue });

/// The refusal of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused {
    /// The blob.
    pub id: BlobId,
    /// Why.
    pub reason: RefusedReason,
}

message_fields!(Refused { id: SceneValue, reason });

/// Why a blob is not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub enum RefusedReason {
    /// There is no such blob.
    NotFound,
    /// The server cannot read it at present.
    Unreadable,
    /// Too many requests are queued; request it again later.
    QueueFull,
    /// It is longer than the client's `max_blob_bytes`.
    TooLong,
    /// The requested part is empty or reaches beyond the blob.
    OutOfRange,
}

/// Why a session ends. The number is the application error code on QUIC.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Encode, Decode)]
pub enum CloseCode {
    /// The client sent `Bye`, or the user left.
    Normal,
    /// The server shuts down; connect again later.
    ShuttingDown,
    /// No common version.
    Version,
    /// No such scene.
    NoSuchScene,
    /// Invalid bytes, or a message in the wrong order.
    Protocol,
    /// A limit was exceeded.
    Limit,
    /// The peer was silent, or the transport blocked, for too long.
    Timeout,
    /// The server is full.
    Busy,
    /// The transport failed. Never sent.
    Lost,
    /// The client has no valid token for the scene, or its token has expired.
    Unauthorised,
}

impl CloseCode {
    /// All codes, in numeric order.
    pub const ALL: [Self; 10] = [
        Self::Normal,
        Self::ShuttingDown,
        Self::Version,
        Self::NoSuchScene,
        Self::Protocol,
        Self::Limit,
        Self::Timeout,
        Self::Busy,
        Self::Lost,
        Self::Unauthorised,
    ];

    /// The number used as QUIC application error code; add 4000 for a WebSocket close code.
    #[must_use]
    pub const fn number(self) -> u16 {
        self as u16
    }

    /// The code with a number.
    #[must_use]
    pub fn from_number(number: u64) -> Option<Self> {
        usize::try_from(number).ok().and_then(|n| Self::ALL.get(n).copied())
    }

    /// Whether reconnecting later may succeed.
    #[must_use]
    pub const fn worth_retrying(self) -> bool {
        matches!(self, Self::ShuttingDown | Self::Timeout | Self::Busy | Self::Lost)
    }
}

/// The end of a session: a code for programs and a line for people.
#[derive(Clone, Debug, PartialEq, Eq, Encode, Decode)]
pub struct Close {
    /// Why, for programs.
    pub code: CloseCode,
    /// Why, for people: one line.
    pub reason: String,
}

impl Close {
    /// A close with a reason, cut to [`MAX_REASON_BYTES`]. Reasons come from peers and are shown in terminals, so
    /// control characters, line ends and changes of text direction are replaced by U+FFFD.
    pub fn new(code: CloseCode, reason: impl Into<String>) -> Self {
        let reason: String = reason.into();
        let mut reason = reason.replace(is_hidden, "\u{fffd}");
        let mut end = reason.len().min(MAX_REASON_BYTES);
        while !reason.is_char_boundary(end) {
            end -= 1;
        }
        reason.truncate(end);
        Self { code, reason }
    }
}

/// Whether a character is invisible or changes how others are shown.
fn is_hidden(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
}

impl std::fmt::Display for Close {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({:?})", self.reason, self.code)
    }
}

/// A message with an invalid value.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MessageError {
    /// Longer than [`MAX_NAME_BYTES`].
    #[error("the scene's name is too long")]
    SceneName,
    /// Longer than [`MAX_TOKEN_BYTES`].
    #[error("the token is too long")]
    Token,
    /// The lowest version is above the highest.
    #[error("the range of versions is empty")]
    Versions,
    /// More than [`MAX_HAVE`].
    #[error("the list of held blobs is too long")]
    Have,
    /// More than [`MAX_IDS_PER_MESSAGE`].
    #[error("too many wants in one message")]
    TooManyWants,
    /// More than [`MAX_IDS_PER_MESSAGE`].
    #[error("too many cancels in one message")]
    TooManyCancels,
    /// More than [`MAX_PAGES_PER_MESSAGE`].
    #[error("too many scene pages in one message")]
    TooManyPages,
    /// More than [`MAX_IDS_PER_MESSAGE`], or none.
    #[error("too many refusals in one message, or none")]
    Refusals,
    /// Longer than [`MAX_REASON_BYTES`].
    #[error("the reason of a close is too long")]
    Reason,
    /// The view is invalid.
    #[error(transparent)]
    View(#[from] ViewError),
    /// The header or page of the scene is invalid.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The summary of punctual lights is invalid.
    #[error(transparent)]
    PunctualLights(#[from] PunctualLightsError),
    /// The summary of the parts' names is invalid.
    #[error(transparent)]
    Parts(#[from] PartsError),
    /// The summary of animated models is invalid.
    #[error(transparent)]
    Animations(#[from] AnimationError),
}

fn ensure(ok: bool, why: MessageError) -> Result<(), MessageError> {
    if ok { Ok(()) } else { Err(why) }
}

impl ClientMessage {
    /// Checks the values; decoding calls this.
    pub(crate) fn check(&self) -> Result<(), MessageError> {
        match self {
            Self::Hello(hello) => {
                ensure(hello.scene.len() <= MAX_NAME_BYTES, MessageError::SceneName)?;
                ensure(hello.version_min <= hello.version_max, MessageError::Versions)?;
                ensure(hello.have.len() <= MAX_HAVE, MessageError::Have)?;
                hello.view.map_or(Ok(()), |view| view.check().map_err(MessageError::View))
            }
            Self::Want(wants) => ensure(wants.len() <= MAX_IDS_PER_MESSAGE, MessageError::TooManyWants),
            Self::Cancel(ids) => ensure(ids.len() <= MAX_IDS_PER_MESSAGE, MessageError::TooManyCancels),
            Self::SetView(view) => Ok(view.check()?),
            Self::WantScenePages(pages) => {
                ensure(pages.len() <= MAX_PAGES_PER_MESSAGE, MessageError::TooManyPages)
            }
            Self::Token(token) => ensure(token.0.len() <= MAX_TOKEN_BYTES, MessageError::Token),
            Self::Ping(_) | Self::Bye => Ok(()),
        }
    }
}

impl ServerMessage {
    /// Checks the values; decoding calls this.
    pub(crate) fn check(&self) -> Result<(), MessageError> {
        match self {
            Self::Welcome(welcome) => Ok(welcome.scene.check()?),
            Self::ScenePage(page) => Ok(page.check()?),
            Self::PunctualLights(punctual_lights) => Ok(punctual_lights.first().map(drop)?),
            Self::Parts(table) => Ok(table.check()?),
            Self::Animations(table) => Ok(table.check()?),
            Self::Close(close) => ensure(close.reason.len() <= MAX_REASON_BYTES, MessageError::Reason),
            Self::RefusedMany(many) => {
                ensure((1..=MAX_IDS_PER_MESSAGE).contains(&many.len()), MessageError::Refusals)
            }
            Self::Refused(_) | Self::BasesSent | Self::Done | Self::Pong(_) => Ok(()),
        }
    }
}
