//! `lodestream-sim`: assesses models, compares meshes, and streams scenes over simulated links.
//!
//! Exit codes: 0 done, 1 figures differ from those committed, 2 bad input (one line says what, where and what to do).

mod draw_trade_command;
mod drawn_case;
mod frame_time_command;
mod goodput_command;
mod load_command;
mod models_command;
mod normals_command;
mod progress;

use std::num::{NonZeroU32, NonZeroUsize};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::Context as _;
use clap::{Parser, Subcommand};
use lodestream_assess::{assess, measure, train};
use lodestream_geometry::{Codec, Metric};
use lodestream_protocol::source::SceneSource;
use lodestream_report::{pictures, reproduce};
use lodestream_scenario::baseline::{self, Library, draco::Encoder, terrain_table};
use lodestream_scenario::{self as scenario, truth};
use lodestream_server::prepare::recipe::{self, Round};
use progress::Progress;

/// Compares meshes and streams scenes over simulated links.
#[derive(Debug, Parser)]
#[command(name = "lodestream-sim", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Assesses the geometry of a model: sizes, speeds, quality, honesty of errors, cost of access.
    Assess {
        /// The model.
        model: PathBuf,
        /// Bits per axis of positions.
        #[arg(long, default_value_t = 12)]
        position_bits: u8,
        /// Faces per region.
        #[arg(long, default_value_t = 1000)]
        region_faces: usize,
        /// Share of the removable vertices that one level removes.
        #[arg(long, default_value_t = lodestream_geometry::Settings::default().level_share)]
        level_share: f64,
        /// Regions that are merged into one at the top, 0.25 to 16.
        #[arg(
            long,
            default_value_t = lodestream_geometry::Settings::default().top_regions,
            value_parser = top_regions
        )]
        top_regions: f64,
        /// Distance of the points of a level's grid of positions over the level's error; 0 for one grid.
        #[arg(long, default_value_t = lodestream_geometry::Settings::default().coarse_grid, value_parser = coarse_grid)]
        coarse_grid: f64,
        /// What a collapse is held to cost: qem or melax.
        #[arg(long, default_value = "qem", value_parser = recipe::parse_metric)]
        metric: Metric,
        /// Order of collapses: heap, or rounds of this share of the vertices.
        #[arg(long, default_value = "heap", value_parser = recipe::parse_round)]
        round_size: Round,
        /// How the geometry is coded: range or zstd.
        #[arg(long, default_value = "range", value_parser = recipe::parse_codec)]
        codec: Codec,
        /// Leaves out texture coordinates, normals and colours.
        #[arg(long)]
        positions_only: bool,
        /// Random closed sets whose stated error is compared with the measured one.
        #[arg(long, default_value_t = 20)]
        random_sets: usize,
        /// Points on each surface.
        #[arg(long, default_value = "200000")]
        samples: NonZeroU32,
        /// Seed of everything random.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Prints one JSON object instead of text.
        #[arg(long)]
        json: bool,
    },
    /// Prepares models with the default settings and streams each over QUIC and WebSocket, over a simulated link of 2 Mbit/s
    /// and 50 ms round trip: sizes, error of the base mesh, time to the first frame.
    Models(models_command::ModelsCommand),
    /// Counts the normals of models that are sent, those further from what the faces say than a tolerance.
    Normals(normals_command::NormalsCommand),
    /// Trains the priors of the entropy coder on some models and writes the table that the geometry crate
    /// includes. The format's version must change with it.
    Train {
        /// The models.
        #[arg(required = true)]
        models: Vec<PathBuf>,
        /// The table: `geometry/src/codec/priors.bin`.
        #[arg(short, long)]
        output: PathBuf,
        /// Bits per axis of positions.
        #[arg(long, default_value_t = 12)]
        position_bits: u8,
    },
    /// Measures the two-sided distance between the surfaces of two model files, and how their attributes
    /// differ.
    Measure {
        /// The reference; distances are divided by the diagonal of its bounding box.
        a: PathBuf,
        /// The mesh that stands for it.
        b: PathBuf,
        /// Points on each surface.
        #[arg(long, default_value = "200000")]
        samples: NonZeroU32,
        /// Seed of the points.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Prints one JSON object instead of text.
        #[arg(long)]
        json: bool,
    },
    /// Prints the older system's table of transfer times for three models of as many triangles, with ours beside it.
    SeedTable {
        /// Prints JSON instead of a table.
        #[arg(long)]
        json: bool,
    },
    /// Prints the older system's tables of terrain: times of many generations of a patch, and bytes; ours and a plain
    /// diamond-square beside it.
    TerrainTable {
        /// Times each size is made.
        #[arg(long, default_value_t = terrain_table::GENERATIONS, value_parser = clap::value_parser!(u32).range(1..=100_000))]
        generations: u32,
        /// Prints JSON instead of tables.
        #[arg(long)]
        json: bool,
    },
    /// Measures how much of a link the server fills, and how long an urgent blob of 8,000 bytes waits behind bulk, in
    /// virtual time.
    Goodput(goodput_command::GoodputCommand),
    /// Measures what a server's sessions cost it: memory and processor time of a process of its own, in real time on
    /// loopback. Needs Linux.
    Load(load_command::LoadCommand),
    /// Settles a plan's case at several targets of screen error, in virtual time, and times frames of each, in real time
    /// on the machine's graphics adapter.
    FrameTime(frame_time_command::FrameTimeCommand),
    /// Settles a plan's case in virtual time and draws it with several values of a setting of the renderer, in real time
    /// on the machine's graphics adapter: time of a frame, and how far the picture is from that with the last value.
    DrawTrade(draw_trade_command::DrawTradeCommand),
    /// Streams scenes over simulated links in virtual time.
    Run {
        /// The plan (TOML).
        plan: PathBuf,
        /// Runs this seed alone, of lost packets, jitter and the endpoints' random numbers [default: the
        /// plan's seeds].
        #[arg(long)]
        seed: Option<u64>,
        /// Another value for a key of the plan, as "client.target_px=4" or "sweep.seeds=3"; may be given more than once.
        #[arg(long, value_name = "KEY=VALUE")]
        set: Vec<String>,
        /// Folder for the report: report.html, results.json and results.csv, plots, pictures if the plan asks for them,
        /// percentiles of cases with seeds enough, and bytes and times until each level of a chain (levels.csv).
        #[arg(short, long, value_name = "DIR")]
        output: PathBuf,
        /// Runs at once [default: as many as there are processors]. The report does not depend on it.
        #[arg(long)]
        threads: Option<NonZeroUsize>,
        /// Folder of prepared packs [default: $XDG_CACHE_HOME/lodestream or ~/.cache/lodestream].
        #[arg(long, env = "LODESTREAM_CACHE", value_name = "DIR")]
        cache: Option<PathBuf>,
        /// Folder of the models that a plan names by their files.
        #[arg(long, env = "LODESTREAM_MODELS", value_name = "DIR")]
        models: Option<PathBuf>,
        /// Nodes of view-dependent peers, instead of the file that the plan names: sim/peers/example.json is one.
        #[arg(long, env = "LODESTREAM_PEERS", value_name = "FILE")]
        peers: Option<PathBuf>,
        /// Draco's encoder [default: draco_encoder, where $PATH has it].
        #[arg(long, env = "LODESTREAM_DRACO_ENCODER", value_name = "FILE")]
        draco_encoder: Option<PathBuf>,
        /// Shows no progress.
        #[arg(long)]
        quiet: bool,
    },
    /// Makes the figures of the benchmarks' pages anew and says what differs from those committed. Reads the project's
    /// own files: run it in its folder.
    Reproduce {
        /// Sections to run [default: all].
        #[arg(value_name = "SECTION")]
        only: Vec<String>,
        /// Folder for figures, reports, reproduction.json and reproduction.html, a page with every section.
        #[arg(short, long, value_name = "DIR")]
        output: PathBuf,
        /// Folder of models that are not part of the project; sections that need them are left out without it.
        #[arg(long, env = "LODESTREAM_MODELS", value_name = "DIR")]
        models: Option<PathBuf>,
        /// The list of sections.
        #[arg(long, value_name = "FILE", default_value = "docs/report/sections.toml")]
        sections: PathBuf,
        /// A page with tables, or a folder of pages; may be given more than once [default: BENCHMARKS.md and
        /// docs/benchmarks].
        #[arg(long, value_name = "FILE|DIR")]
        document: Vec<PathBuf>,
        /// Nodes of view-dependent peers; rows that need them are left out without them.
        #[arg(long, env = "LODESTREAM_PEERS", value_name = "FILE")]
        peers: Option<PathBuf>,
        /// Draco's encoder [default: draco_encoder, where $PATH has it]; rows that need it are left out without it.
        #[arg(long, env = "LODESTREAM_DRACO_ENCODER", value_name = "FILE")]
        draco_encoder: Option<PathBuf>,
        /// Replaces the committed figures and the pages' tables instead of comparing.
        #[arg(long)]
        update: bool,
        /// Runs nothing: replaces the pages' tables by tables of the committed figures.
        #[arg(long, conflicts_with = "update")]
        tables: bool,
    },
    /// Runs the cases of a plan in virtual time and again in real time, over real sockets on loopback and a
    /// relay with the same link code, and says how they differ.
    Truth {
        /// The plan (TOML); each case runs with its first seed.
        plan: PathBuf,
        /// Folder for truth.json, and figures.json, which has a row per figure.
        #[arg(short, long, value_name = "DIR")]
        output: Option<PathBuf>,
        /// Runs of each case in real time; the median is compared.
        #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=i64::from(truth::MAX_REPEATS)))]
        repeats: u32,
        /// Folder of prepared packs [default: $XDG_CACHE_HOME/lodestream or ~/.cache/lodestream].
        #[arg(long, env = "LODESTREAM_CACHE", value_name = "DIR")]
        cache: Option<PathBuf>,
    },
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Train { models, output, position_bits } => run_train(&models, &output, position_bits),
        Command::Assess {
            model,
            position_bits,
            region_faces,
            level_share,
            top_regions,
            coarse_grid,
            metric,
            round_size,
            codec,
            positions_only,
            random_sets,
            samples,
            seed,
            json,
        } => {
            let samples = samples.get() as usize;
            let options = assess::Options {
                position_bits,
                region_faces,
                level_share,
                top_regions,
                coarse_grid,
                metric,
                round: round_size,
                codec,
                positions_only,
                random_sets,
                samples,
                seed,
            };
            run_assess(&model, &options, json)
        }
        Command::Measure { a, b, samples, seed, json } => run_measure(&a, &b, samples, seed, json),
        Command::SeedTable { json } => run_seed_table(json),
        Command::TerrainTable { generations, json } => run_terrain_table(generations, json),
        Command::Models(command) => command.run(),
        Command::Normals(command) => command.run(),
        Command::Goodput(command) => command.run(),
        Command::Load(command) => command.run(),
        Command::FrameTime(command) => command.run(),
        Command::DrawTrade(command) => command.run(),
        Command::Run { plan, seed, set, output, threads, cache, models, peers, draco_encoder, quiet } => {
            let beside = Beside { models, peers, draco_encoder };
            run_plan((&plan, &set), seed, &output, threads, cache, &beside, quiet)
        }
        Command::Reproduce {
            only,
            output,
            models,
            sections,
            document: documents,
            peers,
            draco_encoder,
            update,
            tables,
        } => {
            let mode = match (update, tables) {
                (true, _) => reproduce::Mode::Update,
                (_, true) => reproduce::Mode::Tables,
                _ => reproduce::Mode::Compare,
            };
            let beside = [("LODESTREAM_PEERS", peers), ("LODESTREAM_DRACO_ENCODER", draco_encoder)];
            let environment =
                beside.into_iter().filter_map(|(name, file)| file.map(|file| (name, file))).collect();
            let options = reproduce::Options { sections, documents, models, environment, only, output, mode };
            return match reproduce::run(&options, |line| println!("{line}")) {
                Ok(made) if made.agrees() => ExitCode::SUCCESS,
                Ok(_) => ExitCode::FAILURE,
                Err(error) => refused(&error),
            };
        }
        Command::Truth { plan, output, repeats, cache } => run_truth(&plan, output, repeats, cache),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => refused(&error),
    }
}

fn refused(error: &anyhow::Error) -> ExitCode {
    eprintln!("error: {}", one_line(error));
    ExitCode::from(2)
}

fn top_regions(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(regions) if (0.25..=16.0).contains(&regions) => Ok(regions),
        _ => Err("a number of regions from 0.25 to 16 is needed".to_owned()),
    }
}

fn coarse_grid(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(share) if (0.0..=4.0).contains(&share) => Ok(share),
        _ => Err("a share from 0 to 4 is needed".to_owned()),
    }
}

/// What a plan needs that is not in it.
struct Beside {
    models: Option<PathBuf>,
    peers: Option<PathBuf>,
    draco_encoder: Option<PathBuf>,
}

impl Beside {
    fn add_to(&self, plan: scenario::plan::Plan) -> anyhow::Result<scenario::plan::Plan> {
        let mut plan = plan.with_models(self.models.as_deref());
        if let Some(file) = &self.peers {
            plan = plan.with_peers(baseline::peers::read(file)?);
        }
        plan.draco = match &self.draco_encoder {
            Some(file) => Some(Encoder::at(file)?),
            None => std::env::var_os("PATH").as_deref().and_then(Encoder::on_path),
        };
        Ok(plan)
    }
}

fn run_plan(
    (plan, changes): (&Path, &[String]),
    seed: Option<u64>,
    output: &Path,
    threads: Option<NonZeroUsize>,
    cache: Option<PathBuf>,
    beside: &Beside,
    quiet: bool,
) -> anyhow::Result<()> {
    let plan = beside.add_to(scenario::plan::read_with(plan, changes)?)?;
    let plan = match seed {
        Some(seed) => plan.with_seed(seed),
        None => plan,
    };
    // Before anything is prepared: without a graphics adapter it would be for nothing.
    let device = plan.pictures.as_ref().map(|_| pictures::open_device()).transpose()?;
    let scenes = open_scenes(&plan, cache, quiet)?;
    let threads = threads.or(std::thread::available_parallelism().ok()).unwrap_or(NonZeroUsize::MIN);
    let library = Library::prepare(&plan, &scenes, |what| {
        if !quiet {
            eprintln!("{what}");
        }
    })?;
    let gallery = device.map(|device| pictures::Gallery::new(device, output)).transpose()?;
    let equipment = scenario::Equipment {
        library: &library,
        gallery: gallery.as_ref().map(|gallery| gallery as &dyn scenario::parallel::Draw),
    };
    let progress = Progress::new(plan.runs(), quiet);
    let results = scenario::run_with(&plan, &scenes, equipment, threads, |result| progress.line(result));
    progress.finish();
    let results = results?;
    lodestream_report::write_drawn(output, &plan, &results, gallery)
        .with_context(|| format!("{}: the report cannot be written", output.display()))
}

fn open_scenes(
    plan: &scenario::plan::Plan,
    cache: Option<PathBuf>,
    quiet: bool,
) -> anyhow::Result<Vec<Arc<dyn SceneSource>>> {
    let cache = cache
        .or_else(lodestream_server::prepare::cache::default_folder)
        .context("no cache folder is known; name one with --cache DIR")?;
    let open =
        |scene: &scenario::plan::PlanScene| scenario::scene::open(&scene.choice, plan.codec, &cache, quiet);
    plan.scenes.iter().map(open).collect()
}

fn run_truth(
    plan: &Path,
    output: Option<PathBuf>,
    repeats: u32,
    cache: Option<PathBuf>,
) -> anyhow::Result<()> {
    let plan = scenario::plan::read(plan)?;
    let scenes = open_scenes(&plan, cache, true)?;
    let compared = truth::run(&plan, &scenes, repeats, |comparison| println!("{comparison}"))?;
    match output {
        Some(folder) => {
            use lodestream_report::write_json;
            write_json(&folder, "truth.json", &compared)
                .and_then(|()| write_json(&folder, "figures.json", &truth::figures(&compared)))
                .with_context(|| format!("{}: the report cannot be written", folder.display()))
        }
        None => Ok(()),
    }
}

/// The error and its causes, less causes that the text before them quotes already.
fn one_line(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |mut line, cause| {
        if !line.contains(&cause) {
            if !line.is_empty() {
                line.push_str(": ");
            }
            line.push_str(&cause);
        }
        line
    })
}

fn run_train(models: &[PathBuf], output: &Path, position_bits: u8) -> anyhow::Result<()> {
    let table = train::train(models, position_bits)?;
    std::fs::write(output, &table).with_context(|| format!("{}: cannot be written", output.display()))?;
    println!("{}: {} bytes", output.display(), table.len());
    Ok(())
}

fn run_assess(model: &Path, options: &assess::Options, json: bool) -> anyhow::Result<()> {
    let found = assess::assess(model, options)?;
    if json {
        println!("{}", serde_json::to_string(&found)?);
    } else {
        println!("{found}");
    }
    Ok(())
}

fn run_seed_table(json: bool) -> anyhow::Result<()> {
    let table = baseline::seed_table::seed_table()?;
    if json {
        println!("{}", serde_json::to_string(&table)?);
    } else {
        println!("{table}");
    }
    Ok(())
}

fn run_terrain_table(generations: u32, json: bool) -> anyhow::Result<()> {
    let table = terrain_table::terrain_table(generations)?;
    if json {
        println!("{}", serde_json::to_string(&table)?);
    } else {
        println!("{table}");
    }
    Ok(())
}

fn run_measure(a: &Path, b: &Path, samples: NonZeroU32, seed: u64, json: bool) -> anyhow::Result<()> {
    let samples = NonZeroUsize::try_from(samples)?;
    let settings = measure::Settings { samples, seed, ..Default::default() };
    let meshes = measure::read_models(a, b)?;
    let [first, second] = meshes.each_ref().map(measure::Surface::from);
    let found = measure::compare(&first, &second, &settings)
        .with_context(|| format!("cannot compare {} with {}", a.display(), b.display()))?;
    let attributes = measure::compare_attributes(&meshes[0], &meshes[1], &settings);
    if json {
        let mut value = serde_json::to_value(found)?;
        value["attributes"] = serde_json::to_value(attributes)?;
        println!("{value}");
        return Ok(());
    }
    let line = |name: &str, value: f64| println!("{name} {value:.6e} ({:.3}e-5)", value * 1e5);
    println!("diagonal of {}: {} (distances are fractions of it)", a.display(), found.diagonal);
    println!("samples {} on each surface, seed {seed}", found.samples);
    line("first to second: rms", found.a_to_b.rms);
    line("first to second: max", found.a_to_b.max);
    line("second to first: rms", found.b_to_a.rms);
    line("second to first: max", found.b_to_a.max);
    line("rms", found.rms);
    line("max", found.max);
    let attribute = |name: &str, found: Option<measure::Differences>| match found {
        Some(d) => println!("{name} rms {:.6} max {:.6} beyond 0.01 {:.4}", d.rms, d.max, d.beyond),
        None => println!("{name} -"),
    };
    attribute("texture coordinates:", attributes.uv);
    attribute("normals (chord):", attributes.normal);
    attribute("colours:", attributes.color);
    if let Some(share) = attributes.material {
        println!("other material: {share:.4}");
    }
    Ok(())
}
