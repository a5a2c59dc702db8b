//! `serve --config FILE`: flags from a TOML file. Keys are the flags of `serve` without their dashes, and `files`.
//!
//! A value of the file becomes an argument of the command line, unless the command line or the environment gives the
//! same option, so it is parsed and checked as the flag is. Paths are relative to the file's folder.

use std::any::TypeId;
use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail};
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Command};
use lodestream_compress::whole_file;
use toml::{Spanned, Value};

use super::outcome::Outcome;
use lodestream_store::Objects;

/// Longest file that is read, in bytes.
const MAX_BYTES: u64 = 1 << 20;
/// Flags that a file cannot set.
const NOT_IN_FILES: [&str; 4] = ["config", "save-config", "help", "version"];

/// The arguments of a command line, with those that the file of `--config` adds.
///
/// # Errors
/// The file cannot be read, or has an unknown key.
pub(super) fn with_file(command: &Command, words: Vec<OsString>) -> anyhow::Result<Vec<OsString>> {
    // Errors in the arguments are reported when the complete command line is parsed.
    let found = command.clone().ignore_errors(true).try_get_matches_from(&words);
    let said = found.ok().and_then(|matches| matches.subcommand_matches("serve").cloned());
    let file = said.as_ref().and_then(|said| said.try_get_one::<PathBuf>("config").ok().flatten());
    let (Some(said), Some(file), Some(serve)) = (&said, file, command.find_subcommand("serve")) else {
        return Ok(words);
    };
    let more = read(file, serve, said).with_context(|| file.display().to_string())?;
    let at = words.iter().position(|word| word == "serve").map_or(words.len(), |at| at + 1);
    let (before, after) = words.split_at(at);
    Ok([before, &more, after].concat())
}

/// The arguments that a file stands for. `said` are those of the command line, which take precedence.
fn read(file: &Path, serve: &Command, said: &ArgMatches) -> anyhow::Result<Vec<OsString>> {
    let bytes = std::fs::metadata(file)?.len();
    if bytes > MAX_BYTES {
        bail!("the file has {bytes} bytes; at most {MAX_BYTES} are read");
    }
    let text = std::fs::read_to_string(file)?;
    let table: BTreeMap<String, Spanned<Value>> = toml::from_str(&text)?;
    let folder = file.parent().unwrap_or(Path::new(""));
    let mut words = Vec::new();
    for (key, value) in table {
        let line = text[..value.span().start.min(text.len())].matches('\n').count() + 1;
        let argument = serve.get_arguments().find(|argument| name(argument) == Some(key.as_str()));
        let Some(argument) = argument.filter(|_| !NOT_IN_FILES.contains(&key.as_str())) else {
            bail!("line {line}: unknown key {key}; keys are flags of serve without their dashes, and files");
        };
        if said.value_source(argument.get_id().as_str()).is_some_and(|from| from != ValueSource::DefaultValue)
        {
            continue;
        }
        let add = as_words(&key, argument, value.get_ref(), folder);
        words.extend(add.map_err(|why| anyhow!("line {line}: {key}: {why}"))?);
    }
    Ok(words)
}

/// The key of an argument in a file.
fn name(argument: &Arg) -> Option<&str> {
    argument.get_long().or_else(|| (argument.get_id() == "files").then_some("files"))
}

fn is_path(argument: &Arg) -> bool {
    argument.get_value_parser().type_id() == TypeId::of::<PathBuf>()
}

/// A key and its value as arguments of a command line.
fn as_words(key: &str, argument: &Arg, value: &Value, folder: &Path) -> Result<Vec<OsString>, &'static str> {
    if let ArgAction::SetTrue = argument.get_action() {
        return match value {
            Value::Boolean(true) => Ok(vec![format!("--{key}").into()]),
            Value::Boolean(false) => Ok(Vec::new()),
            _ => Err("must be true or false"),
        };
    }
    let one = |value: &Value| -> Result<OsString, &'static str> {
        match value {
            Value::String(text) if is_path(argument) && !Objects::is_url(Path::new(text)) => {
                Ok(folder.join(text).into_os_string())
            }
            Value::String(text) => Ok(text.into()),
            Value::Integer(number) => Ok(number.to_string().into()),
            Value::Float(number) => Ok(number.to_string().into()),
            _ => Err("must be a string or a number, or a list of these"),
        }
    };
    let all = match value {
        Value::Array(values) => values.iter().map(one).collect::<Result<Vec<_>, _>>()?,
        value => vec![one(value)?],
    };
    if argument.is_positional() {
        return Ok(all);
    }
    let flag = |value: OsString| -> OsString {
        let mut word = OsString::from(format!("--{key}="));
        word.push(value);
        word
    };
    Ok(all.into_iter().map(flag).collect())
}

/// Writes the options that result from command line, environment and file as a file for `--config`.
///
/// # Errors
/// The file cannot be written, or a value is not UTF-8.
pub(super) fn save(command: &Command, words: &[OsString], file: &Path) -> anyhow::Result<Outcome> {
    let matches = command.clone().try_get_matches_from(words)?;
    let (Some(said), Some(serve)) = (matches.subcommand_matches("serve"), command.find_subcommand("serve"))
    else {
        bail!("only serve has a configuration file");
    };
    let mut text = String::from(
        "# Options of lodestream-server serve, for --config. Flags and environment take precedence.\n",
    );
    for argument in serve.get_arguments() {
        let Some(key) = name(argument).filter(|key| !NOT_IN_FILES.contains(key)) else { continue };
        let id = argument.get_id().as_str();
        let value = match argument.get_action() {
            ArgAction::SetTrue => said.get_flag(id).to_string(),
            _ => {
                let Some(values) = said.get_raw(id) else { continue };
                let values =
                    values.map(|value| quoted(argument, value)).collect::<anyhow::Result<Vec<_>>>()?;
                match &values[..] {
                    [one] if !argument.is_positional() => one.clone(),
                    all => format!("[{}]", all.join(", ")),
                }
            }
        };
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{key} = {value}");
    }
    whole_file::write_atomically(file, |out| out.write_all(text.as_bytes()))
        .with_context(|| file.display().to_string())?;
    Ok(Outcome::good(format!("{} was written\n", file.display())))
}

/// A value as TOML: a number if possible, else a string. Paths become absolute, since those in files are relative to
/// the file's folder.
fn quoted(argument: &Arg, value: &OsStr) -> anyhow::Result<String> {
    let path = is_path(argument) && !Objects::is_url(Path::new(value));
    let path = path.then(|| std::path::absolute(value)).transpose()?;
    let value = path.as_deref().map_or(value, Path::as_os_str);
    let text = value.to_str().with_context(|| format!("{} is not UTF-8", value.display()))?;
    Ok(match text.parse::<i64>() {
        Ok(number) if path.is_none() && number.to_string() == text => text.to_owned(),
        _ => Value::String(text.to_owned()).to_string(),
    })
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory as _, Parser as _};

    use super::super::Cli;
    use super::*;

    fn words(line: &str) -> Vec<OsString> {
        line.split(' ').map(OsString::from).collect()
    }

    /// A folder with a file of this text, and the arguments that result from a command line with it.
    fn given(text: &str, rest: &str) -> (tempfile::TempDir, anyhow::Result<Vec<String>>) {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("server.toml");
        std::fs::write(&file, text).unwrap();
        let line = words(&format!("lodestream-server serve --config {}{rest}", file.display()));
        let found = with_file(&Cli::command(), line);
        (folder, found.map(|words| words.iter().map(|word| word.to_str().unwrap().to_owned()).collect()))
    }

    #[test]
    fn flags_override_files_and_files_override_defaults() {
        let text = "files = [\"a.obj\", \"b.obj\"]\nrate = \"2Mbit\"\nmax-sessions = 50\nhttp-tls = true\n\
                    allow-origin = [\"https://a.example\", \"https://b.example\"]\n";
        let (folder, found) = given(text, " --max-sessions 7");
        let found = found.unwrap();
        assert!(Cli::try_parse_from(&found).is_ok(), "{found:?}");
        let a = folder.path().join("a.obj");
        for word in [a.to_str().unwrap(), "--rate=2Mbit", "--http-tls", "--allow-origin=https://b.example"] {
            assert!(found.iter().any(|found| found == word), "{word} of {found:?}");
        }
        assert!(!found.iter().any(|word| word == "--max-sessions=50"), "{found:?}");
        // Models on the command line replace those in the file.
        let (_, found) = given(text, " c.obj");
        assert!(!found.unwrap().iter().any(|word| word.ends_with("a.obj")));
        let line = words("lodestream-server serve a.obj");
        assert_eq!(with_file(&Cli::command(), line.clone()).unwrap(), line);
    }

    #[test]
    fn unknown_keys_and_invalid_values_are_refused_with_their_line() {
        for (text, why) in [
            ("rate = \"off\"\nrates = 3\n", "line 2: unknown key rates"),
            ("\n\nconfig = \"x.toml\"\n", "line 3: unknown key config"),
            ("http-tls = \"yes\"\n", "line 1: http-tls: must be true or false"),
            ("rate = { fast = true }\n", "line 1: rate: must be a string or a number"),
            ("rate = \n", "line 1"),
        ] {
            let (_, found) = given(text, "");
            let said = format!("{:#}", found.unwrap_err());
            assert!(said.contains("server.toml") && said.contains(why), "{said}");
        }
        // A value out of range gets the error of its flag.
        let (_, found) = given("files = \"a.obj\"\nmax-sessions = 0\n", "");
        assert!(Cli::try_parse_from(found.unwrap()).unwrap_err().to_string().contains("--max-sessions"));
        let line = words("lodestream-server serve --config nowhere/server.toml");
        assert!(
            format!("{:#}", with_file(&Cli::command(), line).unwrap_err()).contains("nowhere/server.toml")
        );
    }

    #[test]
    fn a_saved_file_gives_the_same_options() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("saved.toml");
        let line = words(
            "lodestream-server serve a.obj --rate 500kbit --total-rate 1Gbit --position-bits 12 --http-tls --allow-origin *,https://a.example",
        );
        save(&Cli::command(), &line, &file).unwrap();
        let back = words(&format!("lodestream-server serve --config {}", file.display()));
        let back = with_file(&Cli::command(), back).unwrap();
        let again = folder.path().join("again.toml");
        save(&Cli::command(), &back, &again).unwrap();
        let [first, second] = [file, again].map(|file| std::fs::read_to_string(file).unwrap());
        assert_eq!(first, second);
        for part in [
            "position-bits = 12",
            "rate = \"500kbit\"",
            "rate-per-address = \"off\"",
            "total-rate = \"1Gbit\"",
            "http-tls = true",
            "max-sessions = 1000",
            "drain = 3",
        ] {
            assert!(first.contains(part), "{part} of {first}");
        }
    }
}
