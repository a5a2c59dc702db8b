//! Control messages: what the two peers say to each other beside the blobs themselves.

use bincode::{Decode, Encode};

use lodestream_scene::blob::BlobId;
use lodestream_scene::description::{Fingerprint, SceneError, SceneHeader, ScenePage};
use lodestream_scene::limits::{
    MAX_BLOB_BYTES, MAX_HAVE, MAX_IDS_PER_MESSAGE, MAX_NAME_BYTES, MAX_PAGES_PER_MESSAGE, MAX_REASON_BYTES,
    MAX_TOKEN_BYTES,
};
use lodestream_scene::punctual_lights::{PunctualLights, PunctualLightsError};
use lodestream_scene::view::{View, ViewError};

/// Versions of the protocol that this crate speaks.
pub const VERSIONS: std::ops::RangeInclusive<u16> = 4..=4;

/// From client to server.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientMessage {
    /// Opens the session; first, once.
    Hello(Hello),
    /// Asks for blobs or parts of them, or changes the priority of blobs asked for. Bytes already sent are
    /// not sent again, unless a `Cancel` came between.
    Want(Vec<Want>),
    /// Takes requests back. What has been handed to the transport still arrives; in any case the server
    /// forgets that it sent these blobs, so a client that evicts a blob cancels it as well.
    Cancel(Vec<BlobId>),
    /// The view has changed; orders what the server sends unasked.
    SetView(View),
    /// Asks for pages of the scene description ahead of their turn.
    WantScenePages(Vec<u32>),
    /// Shows that the client may see the scene: before `Hello`, and again before that grant ends. Servers that ask for
    /// none pass it over.
    Token(Token),
    /// Shows that the client is alive; answered by `Pong` at once.
    Ping(u32),
    /// The client leaves.
    Bye,
}

/// A client's first message.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
pub struct Hello {
    /// Lowest version that the client speaks.
    pub version_min: u16,
    /// Highest version that the client speaks.
    pub version_max: u16,
    /// Name of the scene; empty for the server's default.
    pub scene: String,
    /// What the client looks at; `None` for the scene's start view.
    pub view: Option<View>,
    /// Longest blob that the client takes, in bytes.
    pub max_blob_bytes: u32,
    /// Bytes that the client can hold in all; the server sends no more than this unasked.
    pub budget_bytes: u64,
    /// Fingerprint of the scene that `have` is about.
    pub fingerprint: Fingerprint,
    /// Blobs that the client still has from an earlier session, which are not sent unasked.
    pub have: Vec<BlobId>,
}

impl Hello {
    /// A first message in the versions that this crate speaks, for the scene of that name (empty for the
    /// server's default): from its start view, with nothing kept from an earlier session, blobs as long as
    /// there are, and room for a gibibyte of them.
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

/// A bearer token: whoever has it may do what it grants. Its text is not shown where a token is printed.
#[derive(Clone, PartialEq, Eq, Encode, Decode)]
pub struct Token(pub String);

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Token of {} bytes", self.0.len())
    }
}

/// One request: a blob, or the part of it from `offset` to `end`, and its priority.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub struct Want {
    /// The blob.
    pub id: BlobId,
    /// Higher is sent first; see [`lodestream_select::Priority`].
    pub priority: u32,
    /// Bytes of the blob's beginning that the client has: what is sent begins there, or later where the
    /// server has sent more. Below the blob's length.
    pub offset: u32,
    /// Where it ends, above `offset` and at most the blob's length; `None` for the blob's end.
    pub end: Option<u32>,
}

impl Want {
    /// Asks for all of a blob.
    #[must_use]
    pub const fn whole(id: BlobId, priority: u32) -> Self {
        Self { id, priority, offset: 0, end: None }
    }
}

/// From server to client.
#[derive(Clone, Debug, PartialEq)]
pub enum ServerMessage {
    /// Opens the session; first, once, perhaps before the `Hello` was heard.
    Welcome(Welcome),
    /// A page of the scene description.
    ScenePage(ScenePage),
    /// The scene has punctual lights: behind `Welcome`, once, where it has any. Clients that know of none skip it.
    PunctualLights(PunctualLights),
    /// A blob that was asked for will not come.
    Refused(Refused),
    /// The same of several blobs, two at least and at most [`MAX_IDS_PER_MESSAGE`].
    RefusedMany(Vec<Refused>),
    /// All visible instances' base meshes and the pages that place them have been handed over, for the
    /// view last known. Informative: on QUIC it may overtake blobs.
    BasesSent,
    /// Nothing is queued: everything asked for has been handed over.
    Done,
    /// Answers a `Ping`.
    Pong(u32),
    /// The server ends the session.
    Close(Close),
}

/// A server's first message.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
pub struct Welcome {
    /// Version that the server speaks. The client closes if it cannot.
    pub version: u16,
    /// Number of the session, for logs.
    pub session: u64,
    /// Rate that the limiter admits, in bits per second; 0 for unlimited.
    pub rate_bits_per_s: u64,
    /// Silence after which the server closes, in milliseconds. The client pings well before that.
    pub idle_timeout_ms: u32,
    /// The scene.
    pub scene: SceneHeader,
}

/// A request that is not granted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub struct Refused {
    /// The blob.
    pub id: BlobId,
    /// Why.
    pub reason: RefusedReason,
}

/// Why a blob is not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub enum RefusedReason {
    /// There is no such blob.
    NotFound,
    /// The server cannot read it, now.
    Unreadable,
    /// Too many requests are queued; ask again later.
    QueueFull,
    /// It is longer than the client's `max_blob_bytes`.
    TooLong,
    /// The part asked for is empty or reaches beyond the blob.
    OutOfRange,
}

/// Why a session ends. The number is the application error code on QUIC.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Encode, Decode)]
pub enum CloseCode {
    /// The peer said `Bye`, or the user left.
    Normal,
    /// The server shuts down; connect again later.
    ShuttingDown,
    /// No common version.
    Version,
    /// No such scene.
    NoSuchScene,
    /// Bytes that are not a message, or a message out of turn.
    Protocol,
    /// A limit was exceeded.
    Limit,
    /// Nothing was heard for too long, or nothing could be sent for too long.
    Timeout,
    /// The server is full.
    Busy,
    /// The transport failed. Never sent.
    Lost,
    /// The client showed no token that grants it the scene, or its token has ended.
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

    /// The code of a number.
    #[must_use]
    pub fn from_number(number: u64) -> Option<Self> {
        usize::try_from(number).ok().and_then(|n| Self::ALL.get(n).copied())
    }

    /// Whether connecting again, later, can help.
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
    /// A close with a reason, cut to [`MAX_REASON_BYTES`]. What a terminal would obey or hide instead of showing it (control
    /// characters, line ends, changes of direction) is replaced by U+FFFD: reasons come from peers, and go to terminals.
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

/// Whether a character is more than what is seen of it.
fn is_hidden(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
}

impl std::fmt::Display for Close {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({:?})", self.reason, self.code)
    }
}

/// A message that says what cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MessageError {
    /// Longer than [`MAX_NAME_BYTES`].
    #[error("the scene's name is too long")]
    SceneName,
    /// Longer than [`MAX_TOKEN_BYTES`].
    #[error("the token is too long")]
    Token,
    /// The lowest is above the highest.
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
    /// Its view.
    #[error(transparent)]
    View(#[from] ViewError),
    /// Its part of the scene's description.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// What it says of punctual lights.
    #[error(transparent)]
    PunctualLights(#[from] PunctualLightsError),
}

fn ensure(ok: bool, why: MessageError) -> Result<(), MessageError> {
    if ok { Ok(()) } else { Err(why) }
}

impl ClientMessage {
    /// Why the message cannot be accepted, if so; decoding calls this.
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
    /// Why the message cannot be accepted, if so; decoding calls this.
    pub(crate) fn check(&self) -> Result<(), MessageError> {
        match self {
            Self::Welcome(welcome) => Ok(welcome.scene.check()?),
            Self::ScenePage(page) => Ok(page.check()?),
            Self::PunctualLights(punctual_lights) => Ok(punctual_lights.first().map(drop)?),
            Self::Close(close) => ensure(close.reason.len() <= MAX_REASON_BYTES, MessageError::Reason),
            Self::RefusedMany(many) => {
                ensure((1..=MAX_IDS_PER_MESSAGE).contains(&many.len()), MessageError::Refusals)
            }
            Self::Refused(_) | Self::BasesSent | Self::Done | Self::Pong(_) => Ok(()),
        }
    }
}
