//! Arguments in groups, of which `--help` shows those that most runs need, and `--help-all` all.

use clap::{Command, CommandFactory as _, FromArgMatches as _};

use crate::args::Args;

/// A group of arguments.
struct Group {
    title: &'static str,
    /// Shown by `--help`.
    usual: &'static [&'static str],
    /// Shown by `--help-all` alone.
    rare: &'static [&'static str],
}

const GROUPS: [Group; 9] = [
    Group { title: "Files", usual: &["watch", "share", "up"], rare: &["cache"] },
    Group { title: "Server", usual: &["token_file"], rare: &["ca"] },
    Group {
        title: "Window",
        usual: &["window", "no_overlay", "settings"],
        rare: &["frame_rate", "exit_when_settled", "timeout", "frames"],
    },
    Group {
        title: "Picture",
        usual: &[
            "headless",
            "output",
            "picture_size",
            "transparent",
            "turntable",
            "camera_path",
            "camera",
            "orthographic",
            "section",
            "pixel_error",
        ],
        rare: &[],
    },
    Group {
        title: "Look",
        usual: &["view", "wireframe", "exposure", "tone_mapping"],
        rare: &["colour_by_level", "anti_aliasing", "no_aa", "no_punctual_lights", "bloom"],
    },
    Group {
        title: "Methods",
        usual: &[],
        rare: &[
            "no_ao",
            "occlusion_method",
            "occlusion_still",
            "occlusion_normals",
            "occlusion_half",
            "no_shadows",
            "no_water",
            "reflections",
            "reflection_steps",
            "no_relief",
            "relief_method",
            "relief_shadows",
            "relief_in_depth",
            "pn_triangles",
            "ink",
            "ink_levels",
            "ink_crease",
            "ink_spatter",
            "ground_heights",
            "ground_seconds",
        ],
    },
    Group { title: "Animation", usual: &["animation", "animation_time"], rare: &[] },
    Group { title: "Parts", usual: &[], rare: &["part", "pick", "hide", "isolate", "tint"] },
    Group {
        title: "Figures and limits",
        usual: &[],
        rare: &["stats", "figures", "max_faces", "cache_mib", "decode_threads"],
    },
];

/// The command line; its help has all arguments, or those that most runs need.
pub(crate) fn command(all: bool) -> Command {
    GROUPS.iter().fold(Args::command(), |command, group| {
        let usual = group.usual.iter().map(|name| (*name, false));
        let rare = group.rare.iter().map(|name| (*name, !all));
        usual.chain(rare).fold(command, |command, (name, hidden)| {
            command.mut_arg(name, |argument| argument.help_heading(group.title).hide(hidden))
        })
    })
}

/// Parses the command line; ends the program with an error message or the help, where these are due.
pub(crate) fn parse(arguments: Vec<std::ffi::OsString>) -> Args {
    let matches = command(false).get_matches_from(arguments);
    match Args::from_arg_matches(&matches) {
        Ok(args) => args,
        Err(why) => why.exit(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_argument_is_in_one_group_and_help_shows_the_usual_ones() {
        let mut grouped: Vec<&str> =
            GROUPS.iter().flat_map(|group| group.usual.iter().chain(group.rare)).copied().collect();
        grouped.extend(["files", "help_all"]);
        grouped.sort_unstable();
        let command = Args::command();
        let mut all: Vec<&str> = command.get_arguments().map(|argument| argument.get_id().as_str()).collect();
        all.sort_unstable();
        assert_eq!(grouped, all);
        super::command(true).debug_assert();
        let [short, long] = [false, true].map(|all| super::command(all).render_help().to_string());
        for (name, is_usual) in [("--watch", true), ("--camera", true), ("--ink", false), ("--stats", false)]
        {
            assert_eq!(short.contains(name), is_usual, "{name}: {short}");
            assert!(long.contains(name), "{name}");
        }
        assert!(short.contains("--help-all") && short.lines().count() < 60, "{}", short.lines().count());
    }
}
