//! Mutants that cargo-mutants makes of `protocol`, `firmware` and `apps`: a sample, or those of changed lines.

use super::Score;
use crate::error::Error;
use crate::needs::Purpose;
use crate::{repo, setup};
use serde::Deserialize;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The crates that are mutated, each tested by its own tests on the host.
const PACKAGES: [&str; 3] = ["multidrop-protocol", "multidrop", "multidrop-apps"];

/// The release of cargo-mutants that is used.
const VERSION: &str = "27.1.0";

/// The time limit for the tests of a mutant.
const SECONDS: u32 = 60;

/// Texts of mutants that never compile in crates without a heap.
const HEAP: [&str; 3] = ["Vec::", "Box::", "String::"];

/// The list of mutants that no test can detect, each with the reason, from the root of the repository.
pub const EQUIVALENT: &str = "tests/equivalent_mutants.toml";

/// The mutants to run.
#[derive(Clone, Copy)]
pub enum Which<'a> {
    /// A sample of this size, by this seed.
    Sample(u32, u64),
    /// The mutants of lines that have changed since this revision.
    Since(&'a str),
}

#[derive(Deserialize)]
struct Mutant {
    name: String,
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct List {
    equivalent: Vec<Equivalent>,
}

/// A mutant with the behaviour of the original code.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Equivalent {
    /// The name in cargo-mutants, without line and column.
    mutant: String,
    /// The reason why no test can detect it.
    why: String,
}

/// Runs the mutants and shows those that no test detected.
///
/// # Errors
/// [`Error::usage`] if cargo-mutants is missing or the revision is unknown, [`Error::failed`] if cargo-mutants fails.
pub fn run(which: Which<'_>) -> Result<Score, Error> {
    setup::prepare(&[Purpose::Mutants])?;
    let made = repo::root().join("target/mutants");
    fs::create_dir_all(&made).map_err(|error| Error::io(made.display(), error))?;
    let mut listing = mutants(&["--list", "--json"])?;
    if let Which::Since(revision) = which {
        listing.arg("--in-diff").arg(diff(revision, &made)?);
    }
    let listed = output(&mut listing)?;
    let mut names: Vec<_> = serde_json::from_slice::<Vec<Mutant>>(&listed)
        .map_err(|error| Error::failed(format!("cargo mutants --list: {error}")))?
        .into_iter()
        .map(|mutant| mutant.name)
        .collect();
    let equivalent = equivalent()?;
    names.retain(|name| {
        !equivalent.contains(&without_place(name)) && !HEAP.iter().any(|word| name.contains(word))
    });
    names.sort();
    names.dedup();
    if let Which::Sample(count, seed) = which {
        choose(&mut names, count as usize, seed);
    }
    if names.is_empty() {
        println!("cargo-mutants makes no mutant of that");
        return Ok(Score::default());
    }
    // A test that fails anyway detects nothing. cargo-mutants would run this baseline with the time limit of a
    // mutant, which is too short on a busy machine.
    let mut baseline = repo::cargo_in_root(&["test"]);
    for package in PACKAGES {
        baseline.args(["--package", package]);
    }
    repo::run(baseline.arg("--quiet").stdout(Stdio::null()))?;
    println!(
        "{} mutants of protocol, firmware and apps, {SECONDS} s each at most",
        names.len()
    );
    let mut run = mutants(&[
        "--no-shuffle",
        "--colors=never",
        "--jobs=2",
        "--baseline=skip",
    ])?;
    run.arg(format!("--timeout={SECONDS}"));
    run.arg("--output").arg(&made);
    for name in &names {
        run.arg(format!("--re=^{}$", literally(name)));
    }
    // 2: some were missed, 3: some hung; both are reported below.
    let status = run
        .status()
        .map_err(|error| Error::io("cargo mutants", error))?;
    if !matches!(status.code(), Some(0 | 2 | 3)) {
        return Err(Error::failed(format!("cargo mutants ended with {status}")));
    }
    let count = |file: &str| {
        let path = made.join("mutants.out").join(file);
        fs::read_to_string(&path)
            .map(|text| text.lines().filter(|line| !line.is_empty()).count())
            .map_err(|error| Error::io(path.display(), error))
    };
    let hung = count("timeout.txt")?;
    let caught = count("caught.txt")? + hung;
    let score = Score {
        caught,
        tried: caught + count("missed.txt")?,
    };
    println!(
        "cargo-mutants: {} of {} caught, {hung} of them because the tests hung; {} did not compile; what was missed: {}",
        score.caught,
        score.tried,
        count("unviable.txt")?,
        made.join("mutants.out/missed.txt").display()
    );
    Ok(score)
}

/// The names of mutants that are not faults.
fn equivalent() -> Result<Vec<String>, Error> {
    let path = repo::root().join(EQUIVALENT);
    let text = fs::read_to_string(&path).map_err(|error| Error::io(path.display(), error))?;
    let list: List = toml::from_str(&text)
        .map_err(|error| Error::failed(format!("{}: {error}", path.display())))?;
    for entry in &list.equivalent {
        if entry.why.trim().is_empty() {
            return Err(Error::failed(format!(
                "{EQUIVALENT}: \"{}\" has no reason in why, must say why no test can see it",
                entry.mutant
            )));
        }
    }
    Ok(list
        .equivalent
        .into_iter()
        .map(|entry| entry.mutant)
        .collect())
}

/// `file:line:column: what` without line and column, which every edit moves.
fn without_place(name: &str) -> String {
    let mut parts = name.splitn(4, ':');
    match (parts.next(), parts.next(), parts.next(), parts.next()) {
        (Some(file), Some(_), Some(_), Some(what)) => format!("{file}:{what}"),
        _ => name.to_owned(),
    }
}

/// Keeps `count` names, selected by the seed (splitmix64, then the smallest).
fn choose(names: &mut Vec<String>, count: usize, seed: u64) {
    let mut state = seed;
    let mut chance = || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    };
    let mut drawn: Vec<_> = names.drain(..).map(|name| (chance(), name)).collect();
    drawn.sort();
    names.extend(drawn.into_iter().take(count).map(|(_, name)| name));
    names.sort();
}

/// A regular expression that matches only `text`.
fn literally(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        // Not every sign: \< and \> are ends of words.
        if "\\.+*?()|[]{}^$".contains(c) {
            out.push('\\');
        }
        out.push(c);
    }
    out
}

/// The changes of the mutated crates since `revision`, as a file.
fn diff(revision: &str, made: &Path) -> Result<PathBuf, Error> {
    let output = Command::new("git")
        .current_dir(repo::root())
        .args(["diff", revision, "--", "protocol", "firmware", "apps"])
        .output()
        .map_err(|error| Error::io("git", error))?;
    if !output.status.success() {
        return Err(Error::usage(format!(
            "--since {revision}: {}",
            String::from_utf8_lossy(&output.stderr).trim()
        )));
    }
    let path = made.join("since.diff");
    fs::write(&path, output.stdout).map_err(|error| Error::io(path.display(), error))?;
    Ok(path)
}

fn mutants(arguments: &[&str]) -> Result<Command, Error> {
    let program = program().ok_or_else(|| Error::failed("cargo-mutants is gone"))?;
    let mut command = Command::new(program);
    command.current_dir(repo::root()).arg("mutants");
    for package in PACKAGES {
        command.args(["--package", package]);
    }
    command.args(arguments);
    Ok(command)
}

/// The path of cargo-mutants: in PATH, or in a folder of this repository.
pub fn program() -> Option<PathBuf> {
    repo::in_path("cargo-mutants").or_else(|| {
        let own = own_tools().join("bin/cargo-mutants");
        own.exists().then_some(own)
    })
}

fn own_tools() -> PathBuf {
    repo::root().join("target/tools")
}

/// Installs cargo-mutants in a folder of this repository, so that nothing else on the machine changes.
///
/// # Errors
/// What cargo says.
pub fn install() -> Result<(), Error> {
    let mut install = repo::cargo();
    install.args([
        "install",
        "cargo-mutants",
        "--locked",
        "--version",
        VERSION,
        "--root",
    ]);
    repo::run(install.arg(own_tools()))
}

fn output(command: &mut Command) -> Result<Vec<u8>, Error> {
    let output = command
        .stderr(Stdio::inherit())
        .output()
        .map_err(|error| Error::io("cargo mutants", error))?;
    match output.status.success() {
        true => Ok(output.stdout),
        false => Err(Error::failed(format!(
            "cargo mutants ended with {}",
            output.status
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_gives_one_sample_and_another_seed_another() {
        let all: Vec<_> = (0..500).map(|number| number.to_string()).collect();
        let sample = |seed| {
            let mut names = all.clone();
            choose(&mut names, 30, seed);
            names
        };
        assert_eq!(sample(1), sample(1));
        assert_eq!(sample(1).len(), 30);
        assert_ne!(sample(1), sample(2));
    }

    #[test]
    fn a_mutant_is_named_without_line_and_column() {
        let name = "protocol/src/crc.rs:12:5: replace f -> u8 with 0";
        assert_eq!(
            without_place(name),
            "protocol/src/crc.rs: replace f -> u8 with 0"
        );
        assert_eq!(literally("a<b> -> (c::d)"), "a<b> -> \\(c::d\\)");
    }

    #[test]
    fn the_list_of_equivalent_mutants_can_be_read() {
        assert!(equivalent().is_ok());
    }
}
