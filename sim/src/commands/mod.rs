//! The commands, one file each: arguments, and the calls into the libraries.

mod assess;
mod draw_trade;
mod frame_time;
mod gallery;
mod generate;
mod goodput;
mod ink_cost;
mod load;
mod measure;
mod models;
mod mutate;
mod normals;
mod occlusion_errors;
mod pn_triangles;
mod reflection_errors;
mod relay;
mod relief_methods;
mod relief_worth;
mod reproduce;
mod run;
mod seed_table;
mod shown;
mod staging;
mod tangent_frames;
mod terrain_table;
mod train;
mod truth;
mod untrusted_peers;

use std::process::ExitCode;

use clap::Subcommand;

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Assess the geometry of a model: sizes, speeds, quality, validity of stated errors, cost of random access.
    Assess(assess::Assess),
    /// Prepare models with default settings and stream each over QUIC and WebSocket, over a simulated link of 2 Mbit/s
    /// and 50 ms round trip: sizes, error of the base mesh, time to the first frame.
    Models(models::Models),
    /// Count the normals of models that are sent: those that deviate from the face normals by more than a tolerance.
    Normals(normals::Normals),
    /// Train the priors of the entropy coder on some models and write the table that the geometry crate includes. The
    /// format's version must change with it.
    Train(train::Train),
    /// Measure the two-sided distance between the surfaces of two model files, and their attribute differences.
    Measure(measure::Measure),
    /// Print the older system's table of transfer times for three models with as many triangles, beside this project's.
    SeedTable(seed_table::SeedTable),
    /// Print the older system's tables of terrain (times of many generations of a patch, and bytes) beside this
    /// project's and those of diamond-square.
    TerrainTable(terrain_table::TerrainTable),
    /// Measure the goodput of the server over a link, and the delay of an urgent blob of 8,000 bytes behind bulk, in
    /// virtual time.
    Goodput(goodput::Goodput),
    /// Measure the cost of a server's sessions: memory and processor time of a separate process, in real time on
    /// loopback. Needs Linux.
    Load(load::Load),
    /// Run a dozen attacks of untrusted peers against a server, one after the other: connections held, memory,
    /// processor time, and delay of another client. In real time on loopback; needs Linux.
    UntrustedPeers(untrusted_peers::UntrustedPeers),
    /// Damage packs, client sessions and server first flights in thousands of ways and count the verdicts: accepted,
    /// refused by kind of reason, panics, time, memory. Daemon and sockets on loopback; needs Linux.
    Mutate(mutate::Mutate),
    /// Relay TCP connections to a server over a rate and a round trip that all share, in real time, for programs such as
    /// browsers and web servers. Prints its address.
    Relay(relay::Relay),
    /// Settle a plan's case at several target screen errors in virtual time, and time frames of each in real time on
    /// the machine's graphics adapter.
    FrameTime(frame_time::FrameTime),
    /// Settle a plan's case in virtual time and draw it with several values of a renderer setting on the machine's
    /// graphics adapter: frame time, and picture error against the last value.
    DrawTrade(draw_trade::DrawTrade),
    /// Settle a plan's case in virtual time and compare methods of ambient occlusion with ray casting on the machine's
    /// graphics adapter: error, and time of their passes.
    OcclusionErrors(occlusion_errors::OcclusionErrors),
    /// Settle a plan's case in virtual time and compare searches of screen-space reflections with ray casting on the
    /// machine's graphics adapter: hit rate, and number of lookups.
    ReflectionErrors(reflection_errors::ReflectionErrors),
    /// Settle a plan's case in virtual time and time frames without ink, with it, and with its parts, in real time on
    /// the machine's graphics adapter.
    InkCost(ink_cost::InkCostOf),
    /// Draw meshes with curved triangles on the machine's graphics adapter: errors while a scene arrives, cost against
    /// the same triangles generated on the host, and numbers drawn at some frame rates.
    PnTriangles(pn_triangles::PnTrianglesOf),
    /// Compare methods of relief mapping, from parallax to a quadtree, with the exact intersection, by angle: wrong
    /// hits, distance, lookups.
    ReliefMethods(relief_methods::ReliefMethods),
    /// Send and draw a wall as a plane with a height map and as a mesh: bytes and times over a simulated link of 2
    /// Mbit/s and 50 ms round trip, frame time on the machine's graphics adapter, FLIP error against a ray-cast
    /// picture.
    ReliefWorth(relief_worth::ReliefWorth),
    /// Compare tangent frames of meshes, from averages at vertices to derivatives in the shader, with those of the
    /// surfaces that they approximate.
    TangentFrames(tangent_frames::TangentFrames),
    /// Settle a plan's case in virtual time and write a page with pictures of it: default, with one technique off, with
    /// alternatives, and in debug views; with their differences from the first, and their frame times.
    Gallery(gallery::Gallery),
    /// Write shell completions or manual pages.
    Generate(generate::Generate),
    /// Stream scenes over simulated links in virtual time.
    Run(run::Run),
    /// Reproduce the benchmarks' figures and report differences from the committed ones. Reads the project's own files:
    /// run it in its folder.
    Reproduce(reproduce::Reproduce),
    /// Compare the frames that a viewer's window showed with the last of them; `lodestream-viewer --frames DIR` stores
    /// them.
    Shown(shown::Shown),
    /// Run the cases of a plan in real time with frames at fixed instants, and measure what these spend on new data:
    /// taking them from the streaming thread and uploading them to the machine's graphics adapter.
    Staging(staging::Staging),
    /// Run the cases of a plan in virtual time and again in real time, over real sockets on loopback and a relay with
    /// the same link code, and compare them.
    Truth(truth::Truth),
}

impl Command {
    /// `program` is the whole command line, for `generate`.
    pub(crate) fn run(&self, program: clap::Command) -> anyhow::Result<ExitCode> {
        match self {
            Self::Assess(command) => command.run(),
            Self::Models(command) => command.run(),
            Self::Normals(command) => command.run(),
            Self::Train(command) => command.run(),
            Self::Measure(command) => command.run(),
            Self::Mutate(command) => command.run(),
            Self::Relay(command) => command.run(),
            Self::SeedTable(command) => command.run(),
            Self::TerrainTable(command) => command.run(),
            Self::Goodput(command) => command.run(),
            Self::Load(command) => command.run(),
            Self::FrameTime(command) => command.run(),
            Self::DrawTrade(command) => command.run(),
            Self::OcclusionErrors(command) => command.run(),
            Self::ReflectionErrors(command) => command.run(),
            Self::InkCost(command) => command.run(),
            Self::PnTriangles(command) => command.run(),
            Self::ReliefMethods(command) => command.run(),
            Self::ReliefWorth(command) => command.run(),
            Self::TangentFrames(command) => command.run(),
            Self::Gallery(command) => command.run(),
            Self::Generate(command) => command.run(program),
            Self::Run(command) => command.run(),
            Self::Shown(command) => command.run(),
            Self::UntrustedPeers(command) => command.run(),
            Self::Staging(command) => command.run(),
            Self::Truth(command) => command.run(),
            // Whether figures agree determines its exit code.
            Self::Reproduce(command) => return command.run(),
        }
        .map(|()| ExitCode::SUCCESS)
    }
}
