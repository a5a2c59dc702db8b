//! Shared by the window and the headless mode: settings from the command line, and the statistics at the end.

use std::io::Write as _;
use std::path::Path;

use anyhow::{Context as _, bail};
use lodestream_client::Threads;
use lodestream_client::core::{Config, Decoders, StartView, Stats};
use lodestream_client::net::{Address, Authorities, Scheme, Server};
use lodestream_render::{
    AmbientOcclusion, AntiAliasing, Bloom, DebugView, Ink, LightCulling, MAX_SECTION_PLANES, OcclusionMethod,
    PnTriangles, Reflections, Settings, Shadows,
};

use crate::args::{Args, StillMethod};
use crate::figures::StatisticsTable;
use crate::files::write_json;
use crate::frames::FrameLog;
use crate::local::Target;
use crate::report::Report;
use crate::token;

/// Longest file of certificate authorities that is read; a system's usual list has a quarter of a megabyte.
const MAX_CA_BYTES: u64 = 4 << 20;

/// Checks arguments that contradict each other.
///
/// # Errors
/// Names them.
pub(crate) fn check(args: &Args, target: &Target) -> anyhow::Result<()> {
    if matches!(target, Target::Stream(_)) && args.watch {
        bail!("--watch is for files; a server tells the viewer itself when its scene has changed");
    }
    if matches!(target, Target::Stream(_)) && args.share.is_some() {
        bail!("--share is for files; others can open the address that you have opened");
    }
    if matches!(target, Target::Stream(_)) && args.up.is_some() {
        bail!("--up is for files; a server's scene says itself how its models stand");
    }
    if matches!(target, Target::Files(_)) && args.ca.is_some() {
        bail!("--ca has no effect: a file needs no certificate");
    }
    if args.occlusion_half && args.occlusion_method == OcclusionMethod::HbaoPlus {
        bail!(
            "--occlusion-half does not work with --occlusion-method hbao-plus, whose layers need every pixel: leave one out"
        );
    }
    if args.sections().is_none() {
        let given = args.section.len();
        bail!("--section is given {given} times, of at most {MAX_SECTION_PLANES}: leave out some");
    }
    Ok(())
}

/// The server to stream from at an address, with the certificate authorities to trust.
///
/// # Errors
/// The file of certificate authorities cannot be used.
pub(crate) fn server(args: &Args, address: &Address) -> anyhow::Result<Server> {
    let mut server = Server::from(address.clone());
    if let Some(file) = &args.ca {
        let why = match address.scheme {
            _ if address.pin.is_some() => {
                Some("the address has a fingerprint, which is checked instead; leave out the part from # on")
            }
            Scheme::WebSocket => Some("ws:// does not use TLS; write wss://"),
            Scheme::Http => Some("http:// does not use TLS; write https://"),
            Scheme::File => Some("a file needs no certificate"),
            _ => None,
        };
        if let Some(why) = why {
            bail!("--ca has no effect: {why}");
        }
        server.authorities = authorities(file).with_context(|| format!("--ca {}", file.display()))?;
    }
    Ok(server)
}

fn authorities(file: &Path) -> anyhow::Result<Authorities> {
    let length = std::fs::metadata(file)?.len();
    if length > MAX_CA_BYTES {
        bail!("it has {length} bytes; a list of certificate authorities has at most {MAX_CA_BYTES}");
    }
    Ok(Authorities::from_pem(&std::fs::read(file)?)?)
}

/// The core's settings for these arguments.
///
/// # Errors
/// The token cannot be read.
pub(crate) fn core_config(args: &Args) -> anyhow::Result<Config> {
    let start = match &args.camera {
        Some(camera) => StartView::Given(args.view_of(&camera.0)),
        None if args.orthographic => {
            StartView::OrthographicOfScene { viewport_px: args.window.0, target_px: args.pixel_error.0 }
        }
        None => StartView::OfScene { viewport_px: args.window.0, target_px: args.pixel_error.0 },
    };
    let mut config = Config::new(start);
    config.session.token = token::load(args.token_file.as_deref())?;
    config.select.max_faces = args.max_faces;
    config.select.shadows = !args.no_shadows;
    config.cache_bytes = u64::from(args.cache_mib) << 20;
    let threads = args.decode_threads.map_or_else(Threads::all_cores_but_one, Threads::new);
    config.decoders = Decoders::on_threads(threads);
    Ok(config)
}

/// The renderer's settings for these arguments. `software`: the driver renders on the CPU.
pub(crate) fn settings(args: &Args, software: bool) -> Settings {
    let mut settings = Settings { relief: !args.no_relief, wireframe: args.wireframe, ..Settings::default() };
    // The mean of 16 frames is too slow on a CPU.
    let usual = StillMethod((!software).then_some(OcclusionMethod::Gtao));
    let ambient = AmbientOcclusion {
        method: args.occlusion_method,
        normals: args.occlusion_normals,
        half: args.occlusion_half,
        still: args.occlusion_still.unwrap_or(usual).0,
        ..AmbientOcclusion::default()
    };
    settings.occlusion = (!args.no_ao).then_some(ambient);
    // Temporal anti-aliasing draws a still picture many times, and helps little at few frames a second.
    let usual = if software { AntiAliasing::Spatial } else { AntiAliasing::Temporal };
    settings.relief_method = args.relief_method.unwrap_or_default();
    settings.relief_shadows = args.relief_shadows;
    settings.relief_in_depth = args.relief_in_depth;
    let anti_aliasing = args.anti_aliasing.unwrap_or(usual);
    settings.anti_aliasing = if args.no_aa { AntiAliasing::None } else { anti_aliasing };
    settings.tone_mapping = args.tone_mapping;
    settings.exposure = args.exposure;
    settings.shadows = (!args.no_shadows).then(Shadows::default);
    settings.lights = (!args.no_punctual_lights).then(LightCulling::default);
    settings.sections = args.sections().unwrap_or_default();
    settings.water = !args.no_water;
    let (method, steps) = (args.reflections, args.reflection_steps);
    settings.reflections = method.map(|method| Reflections { method, steps });
    settings.bloom = (args.bloom > 0.0).then_some(Bloom { strength: args.bloom });
    settings.pn_triangles =
        args.pn_triangles.map(|error| PnTriangles { error_px: error.0, ..PnTriangles::default() });
    settings.ink = args.ink.map(|width_px| Ink {
        width_px,
        levels: args.ink_levels,
        crease_degrees: args.ink_crease,
        spatter: args.ink_spatter,
        ..Ink::default()
    });
    settings.debug_view = if args.colour_by_level { DebugView::Level } else { args.view };
    settings
}

/// Prints the table of `--figures` and writes the file of `--stats`.
pub(crate) fn write_statistics(
    args: &Args,
    transport: &'static str,
    stats: &Stats,
    shown: &FrameLog,
) -> anyhow::Result<()> {
    let report = Report::new(stats, transport, shown);
    if args.figures {
        // A closed pipe is not an error.
        let _ = write!(std::io::stdout(), "{}", StatisticsTable(&report));
    }
    args.stats.as_ref().map_or(Ok(()), |path| write_json(path, &report))
}

#[cfg(test)]
mod tests {
    use lodestream_render::OcclusionNormals;

    use super::*;
    use clap::Parser as _;
    use lodestream_render::{ReflectionMethod, ReliefMethod};

    fn of(flags: &[&str], software: bool) -> Settings {
        settings(&Args::parse_from([&["viewer", "ws://h:1"], flags].concat()), software)
    }

    #[test]
    fn defaults_draw_everything_and_average_frames_on_a_gpu_only() {
        assert_eq!(of(&[], true), Settings::default());
        assert_eq!(of(&[], true).anti_aliasing, AntiAliasing::Spatial);
        let still = AmbientOcclusion { still: Some(OcclusionMethod::Gtao), ..AmbientOcclusion::default() };
        let graphics =
            Settings { anti_aliasing: AntiAliasing::Temporal, occlusion: Some(still), ..Settings::default() };
        assert_eq!(of(&[], false), graphics);
        for (flags, expected) in [
            (&["--anti-aliasing", "temporal"][..], AntiAliasing::Temporal),
            (&["--anti-aliasing", "spatial"], AntiAliasing::Spatial),
            (&["--no-aa"], AntiAliasing::None),
        ] {
            assert_eq!([true, false].map(|software| of(flags, software).anti_aliasing), [expected; 2]);
        }
    }

    #[test]
    fn relief_flags_set_relief() {
        for method in ReliefMethod::ALL {
            assert_eq!(of(&["--relief-method", method.name()], true).relief_method, method);
        }
        assert!(of(&["--relief-shadows"], true).relief_shadows && !of(&[], true).relief_shadows);
        assert!(of(&["--relief-in-depth"], true).relief_in_depth && !of(&[], true).relief_in_depth);
    }

    #[test]
    fn reflection_and_bloom_flags_set_their_passes() {
        for method in ReflectionMethod::ALL {
            let asked =
                |more: &[&str]| of(&[&["--reflections", method.name()], more].concat(), true).reflections;
            assert_eq!(asked(&[]), Some(Reflections { method, ..Reflections::default() }));
            assert_eq!(asked(&["--reflection-steps", "7"]), Some(Reflections { method, steps: 7 }));
        }
        assert_eq!(of(&["--bloom"], true).bloom, Some(Bloom::default()));
        assert_eq!(of(&["--bloom", "0.5"], true).bloom, Some(Bloom { strength: 0.5 }));
        for wrong in
            [["--bloom", "2"], ["--bloom", "nan"], ["--reflections", "guess"], ["--reflection-steps", "9"]]
        {
            assert!(
                Args::try_parse_from([&["viewer", "ws://h:1"], &wrong[..]].concat()).is_err(),
                "{wrong:?}"
            );
        }
    }

    #[test]
    fn the_pn_triangles_flag_sets_their_error() {
        let usual = PnTriangles::default();
        assert_eq!(of(&[], true).pn_triangles, None);
        assert_eq!(of(&["--pn-triangles"], true).pn_triangles, Some(usual));
        let coarse = Some(PnTriangles { error_px: 2.0, ..usual });
        assert_eq!(of(&["--pn-triangles=2"], true).pn_triangles, coarse);
        for wrong in ["0", "-1", "none"] {
            let words = ["viewer", &format!("--pn-triangles={wrong}"), "ws://h:1"];
            assert!(Args::try_parse_from(words).is_err(), "{wrong}");
        }
    }

    #[test]
    fn ink_flags_set_ink() {
        let usual = Ink::default();
        assert_eq!(of(&[], true).ink, None);
        assert_eq!(of(&["--ink"], true).ink, Some(usual));
        assert_eq!(of(&["--ink=0"], true).ink, Some(Ink { width_px: 0.0, ..usual }));
        let words = ["--ink=3.5", "--ink-levels", "6", "--ink-crease", "180", "--ink-spatter", "0"];
        let asked = Ink { width_px: 3.5, levels: 6, crease_degrees: 180.0, spatter: 0.0, ..usual };
        assert_eq!(of(&words, true).ink, Some(asked));
        for wrong in [
            ["--ink=nan", "--no-ao"],
            ["--ink=-1", "--no-ao"],
            ["--ink=33", "--no-ao"],
            ["--ink-levels", "4"],
            ["--ink", "--ink-crease=181"],
            ["--ink", "--ink-levels=0"],
            ["--ink", "--ink-spatter=2"],
        ] {
            let words = [&["viewer", "ws://h:1"], &wrong[..]].concat();
            assert!(Args::try_parse_from(words).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn section_flags_set_planes_up_to_their_bound() {
        let planes = of(&["--section", "0,1,0,2", "--section", "-1,0,0,0.5"], true).sections;
        let normals: Vec<_> = planes.iter().map(|plane| plane.normal().to_array()).collect();
        assert_eq!(normals, [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]);
        for count in [MAX_SECTION_PLANES, MAX_SECTION_PLANES + 1] {
            let words = vec!["--section=0,0,1,0"; count];
            let args = Args::parse_from([&["viewer", "ws://h:1"], &words[..]].concat());
            let checked = check(&args, &Target::of(&args.files).unwrap());
            assert_eq!(checked.is_ok(), count <= MAX_SECTION_PLANES, "{checked:?}");
        }
    }

    #[test]
    fn occlusion_flags_set_method_and_normals() {
        for method in OcclusionMethod::ALL {
            let occlusion = of(&["--occlusion-method", method.name()], true).occlusion;
            assert_eq!(occlusion, Some(AmbientOcclusion { method, ..AmbientOcclusion::default() }));
            let still = of(&["--occlusion-still", method.name()], true).occlusion;
            assert_eq!(still, Some(AmbientOcclusion { still: Some(method), ..AmbientOcclusion::default() }));
        }
        let still = |words: &[&str], software| of(words, software).occlusion.and_then(|some| some.still);
        assert_eq!([true, false].map(|software| still(&[], software)), [None, Some(OcclusionMethod::Gtao)]);
        assert_eq!(still(&["--occlusion-still", "none"], false), None);
        let half = of(&["--occlusion-half"], true).occlusion;
        assert_eq!(half, Some(AmbientOcclusion { half: true, ..AmbientOcclusion::default() }));
        for (method, allowed) in [("gtao", true), ("hbao-plus", false)] {
            let words = ["viewer", "--occlusion-half", "--occlusion-method", method, "ws://h:1"];
            let args = Args::try_parse_from(words).unwrap();
            let target = Target::of(&args.files).unwrap();
            assert_eq!(check(&args, &target).is_ok(), allowed);
        }
        for normals in OcclusionNormals::ALL {
            let occlusion = of(&["--occlusion-normals", normals.name()], true).occlusion;
            assert_eq!(occlusion, Some(AmbientOcclusion { normals, ..AmbientOcclusion::default() }));
        }
    }

    #[test]
    fn each_negative_flag_disables_its_feature() {
        let usual = of(&[], false);
        for (flag, left) in [
            ("--no-ao", Settings { occlusion: None, ..usual }),
            ("--no-shadows", Settings { shadows: None, ..usual }),
            ("--no-punctual-lights", Settings { lights: None, ..usual }),
            ("--no-water", Settings { water: false, ..usual }),
            ("--no-relief", Settings { relief: false, ..usual }),
        ] {
            assert_eq!(of(&[flag], false), left, "{flag}");
            assert_ne!(left, usual);
        }
    }
}
