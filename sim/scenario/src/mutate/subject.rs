//! Subjects of damage, and numbers of cases.

use rand::SeedableRng as _;
use rand_pcg::Pcg64Mcg;

/// The scene whose packs, sessions and first flight are damaged: small, with textures, punctual lights and terrain.
pub(super) const SCENE: &str = "demo-small";
/// Measured cases per warm-up case.
const WARM_UP: u32 = 10;

/// The damaged bytes and their reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// Packs, read by the store, a session that serves them and a client.
    Packs,
    /// The same with correct hashes after the damage, so that it reaches the decoders.
    HashedPacks,
    /// Frames of sessions, read by the shipped daemon over WebSocket.
    WebSocketSessions,
    /// The same over QUIC.
    QuicSessions,
    /// First flights, read by the client's core.
    Flights,
    /// First flights over loopback, read by the client's core behind its own WebSocket.
    Viewers,
}

impl Subject {
    /// All subjects, in the order of the table.
    pub const ALL: [Self; 6] = [
        Self::Packs,
        Self::HashedPacks,
        Self::WebSocketSessions,
        Self::QuicSessions,
        Self::Flights,
        Self::Viewers,
    ];

    /// Name in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Packs => "packs",
            Self::HashedPacks => "packs, hashes made right",
            Self::WebSocketSessions => "sessions over WebSocket, to a daemon",
            Self::QuicSessions => "sessions over QUIC, to a daemon",
            Self::Flights => "first flights, to a client's core",
            Self::Viewers => "first flights over WebSocket, to a client",
        }
    }

    /// The random number generator of a case.
    pub(super) fn random(self, seed: u64, case: u32) -> Pcg64Mcg {
        let subject = Self::ALL.iter().position(|one| *one == self).unwrap_or_default() as u64;
        Pcg64Mcg::seed_from_u64(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ subject << 32 ^ u64::from(case))
    }
}

/// Which cases are run.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Seed of all damage.
    pub seed: u64,
    /// Number of the first case.
    pub first: u32,
    /// Number of cases.
    pub count: u32,
}

impl Settings {
    /// Warm-up cases, none of which is among the measured ones.
    pub(super) fn warm_up(&self) -> Self {
        Self { first: self.first.wrapping_add(self.count), count: self.count.div_ceil(WARM_UP), ..*self }
    }

    pub(super) fn cases(&self) -> impl Iterator<Item = u32> + use<> {
        let first = self.first;
        (0..self.count).map(move |n| first.wrapping_add(n))
    }
}
