//! The commands, one file each: its arguments, and what it does with them by the libraries.

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
    /// Assesses the geometry of a model: sizes, speeds, quality, honesty of errors, cost of access.
    Assess(assess::Assess),
    /// Prepares models with the default settings and streams each over QUIC and WebSocket, over a simulated link of 2 Mbit/s
    /// and 50 ms round trip: sizes, error of the base mesh, time to the first frame.
    Models(models::Models),
    /// Counts the normals of models that are sent, those further from what the faces say than a tolerance.
    Normals(normals::Normals),
    /// Trains the priors of the entropy coder on some models and writes the table that the geometry crate
    /// includes. The format's version must change with it.
    Train(train::Train),
    /// Measures the two-sided distance between the surfaces of two model files, and how their attributes
    /// differ.
    Measure(measure::Measure),
    /// Prints the older system's table of transfer times for three models of as many triangles, with ours beside it.
    SeedTable(seed_table::SeedTable),
    /// Prints the older system's tables of terrain: times of many generations of a patch, and bytes; ours and a plain
    /// diamond-square beside it.
    TerrainTable(terrain_table::TerrainTable),
    /// Measures how much of a link the server fills, and how long an urgent blob of 8,000 bytes waits behind bulk, in
    /// virtual time.
    Goodput(goodput::Goodput),
    /// Measures what a server's sessions cost it: memory and processor time of a process of its own, in real time on
    /// loopback. Needs Linux.
    Load(load::Load),
    /// Lets hostile peers do a dozen things to a server, one after the other: what it holds of them, its memory and processor
    /// time, and how long somebody else waits. In real time on loopback; needs Linux.
    UntrustedPeers(untrusted_peers::UntrustedPeers),
    /// Damages packs, a client's sessions and a server's first flights in thousands of ways and says what comes of it:
    /// taken, refused for what kind of reason, panics, time, memory. Daemon and sockets on loopback; needs Linux.
    Mutate(mutate::Mutate),
    /// Settles a plan's case at several targets of screen error, in virtual time, and times frames of each, in real time
    /// on the machine's graphics adapter.
    FrameTime(frame_time::FrameTime),
    /// Settles a plan's case in virtual time and draws it with several values of a setting of the renderer, in real time
    /// on the machine's graphics adapter: time of a frame, and how far the picture is from that with the last value.
    DrawTrade(draw_trade::DrawTrade),
    /// Settles a plan's case in virtual time and holds methods of ambient occlusion against rays at the triangles that are
    /// drawn, on the machine's graphics adapter: error, and time of their passes.
    OcclusionErrors(occlusion_errors::OcclusionErrors),
    /// Settles a plan's case in virtual time and holds searches of screen-space reflections against rays at the triangles that
    /// are drawn, on the machine's graphics adapter: what is found of what mirrors would show, and lookups.
    ReflectionErrors(reflection_errors::ReflectionErrors),
    /// Settles a plan's case in virtual time and times frames of it without ink, with it, and with its parts, in real time on
    /// the machine's graphics adapter.
    InkCost(ink_cost::InkCostOf),
    /// Draws meshes with curved triangles: pictures of scenes that arrive against the settled one, cost against the same
    /// mesh cut on the host, and how many are drawn at some frame rates, on the machine's graphics adapter.
    PnTriangles(pn_triangles::PnTrianglesOf),
    /// Holds ways of relief mapping, from parallax to a quadtree, against the exact hit by angle: wrong hits, how far off,
    /// lookups.
    ReliefMethods(relief_methods::ReliefMethods),
    /// Sends and draws a wall as a plane with a height map and as a mesh: bytes and times over a simulated link of 2 Mbit/s
    /// and 50 ms round trip, time of a frame on the machine's graphics adapter, FLIP against a picture by rays.
    ReliefWorth(relief_worth::ReliefWorth),
    /// Holds tangent frames of meshes, from averages in their vertices to derivatives in the shader, against those of the
    /// surfaces that they stand for.
    TangentFrames(tangent_frames::TangentFrames),
    /// Settles a plan's case in virtual time and writes a page with pictures of it: as it is shown, without each technique, by
    /// other ways, and by each view for developers; with how far each is from the first, and its time.
    Gallery(gallery::Gallery),
    /// Writes shell completions or manual pages.
    Generate(generate::Generate),
    /// Streams scenes over simulated links in virtual time.
    Run(run::Run),
    /// Makes the figures of the benchmarks' pages anew and says what differs from those committed. Reads the project's
    /// own files: run it in its folder.
    Reproduce(reproduce::Reproduce),
    /// Holds the frames that a viewer's window showed against the last of them: `lodestream-viewer --frames DIR` keeps them.
    Shown(shown::Shown),
    /// Runs the cases of a plan in real time with frames at fixed instants, and says what these spend on what has come
    /// since the last: taking it from the streaming thread and handing it to the machine's graphics adapter.
    Staging(staging::Staging),
    /// Runs the cases of a plan in virtual time and again in real time, over real sockets on loopback and a
    /// relay with the same link code, and says how they differ.
    Truth(truth::Truth),
}

impl Command {
    pub(crate) fn run(&self) -> anyhow::Result<ExitCode> {
        match self {
            Self::Assess(command) => command.run(),
            Self::Models(command) => command.run(),
            Self::Normals(command) => command.run(),
            Self::Train(command) => command.run(),
            Self::Measure(command) => command.run(),
            Self::Mutate(command) => command.run(),
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
            Self::Generate(command) => command.run(),
            Self::Run(command) => command.run(),
            Self::Shown(command) => command.run(),
            Self::UntrustedPeers(command) => command.run(),
            Self::Staging(command) => command.run(),
            Self::Truth(command) => command.run(),
            // What it finds is its exit code.
            Self::Reproduce(command) => return command.run(),
        }
        .map(|()| ExitCode::SUCCESS)
    }
}
