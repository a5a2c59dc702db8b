//! Arguments shared by several commands, and parsers of values.

mod beside;
mod cache;
mod drawn_case;
mod sampling;
mod selection;
mod values;

pub(crate) use beside::Beside;
pub(crate) use cache::CacheFolder;
pub(crate) use drawn_case::DrawnCase;
pub(crate) use sampling::Sampling;
pub(crate) use selection::Selection;
pub(crate) use values::{target_px, transport};

/// A command's arguments as its command line gives them: the first one, then others.
#[cfg(test)]
pub(crate) fn parsed<A: clap::Args>(first: &str, others: &[&str]) -> Result<A, String> {
    #[derive(clap::Parser)]
    struct Line<A: clap::Args> {
        #[command(flatten)]
        command: A,
    }
    let words = ["command", first].into_iter().chain(others.iter().copied());
    let line: Result<Line<A>, _> = clap::Parser::try_parse_from(words);
    line.map(|line| line.command).map_err(|why| why.to_string())
}
