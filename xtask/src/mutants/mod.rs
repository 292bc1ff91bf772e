//! `mutants`: faults planted in the code, one at a time, and whether a test sees each.
//!
//! Two ways. cargo-mutants changes `protocol` and `firmware` by itself, a sample or what a revision changed; the [kept
//! list](planted) has faults that somebody thought of, in drivers, bus and oracles too.

mod copies;
pub mod planted;
mod sample;

pub use sample::{install, program};

use crate::error::Error;
use crate::repo;
use clap::Args;
use copies::{Copy, Verdict};
use planted::Fault;
use std::collections::BTreeSet;
use std::fs;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// How many faults are tried at a time: each builds with two cores.
const AT_A_TIME: usize = 2;

/// Where the score is kept.
const KEPT: &str = "figures/mutants.json";

/// What to plant.
#[derive(Args)]
pub struct MutantsRequest {
    /// Only the kept list
    #[arg(long, conflicts_with_all = ["sample", "since"])]
    kept: bool,
    /// Of the kept list, only faults whose name has this in it; nothing else is planted
    #[arg(long, value_name = "TEXT", conflicts_with_all = ["sample", "since", "record"])]
    only: Option<String>,
    /// How many mutants of protocol and firmware [default: 100]
    #[arg(long, value_name = "N", conflicts_with = "since", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    sample: Option<u32>,
    /// Which sample
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Mutants of what has changed since this revision, in place of a sample
    #[arg(long, value_name = "REV")]
    since: Option<String>,
    /// Keep the score in figures/mutants.json
    #[arg(long)]
    record: bool,
}

/// How many were caught, of how many.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Score {
    /// A test failed.
    pub caught: usize,
    /// All that were tried.
    pub tried: usize,
}

/// What is kept of the last runs.
#[derive(Debug, Default, serde::Serialize, serde::Deserialize)]
#[serde(default)]
struct Scores {
    /// Of cargo-mutants.
    sample: Score,
    /// Its seed.
    seed: u64,
    /// Of the kept list.
    kept: Score,
}

/// Plants, and shows what no test saw.
///
/// # Errors
/// [`Error::failed`] where a fault of the kept list was not seen or does not apply; [`Error::usage`] where cargo-mutants is missing.
pub fn run(request: &MutantsRequest) -> Result<(), Error> {
    let faults = planted::load(repo::root())?;
    let only = request.only.as_deref();
    let chosen: Vec<_> = faults
        .into_iter()
        .filter(|fault| only.is_none_or(|text| fault.name.contains(text)))
        .collect();
    if let (Some(text), true) = (only, chosen.is_empty()) {
        return Err(Error::usage(format!(
            "no planted fault has \"{text}\" in its name"
        )));
    }
    let mut scores = recorded();
    if !request.kept && only.is_none() {
        let which = match &request.since {
            Some(revision) => sample::Which::Since(revision),
            None => sample::Which::Sample(request.sample.unwrap_or(100), request.seed),
        };
        let score = sample::run(which)?;
        if request.since.is_none() {
            scores.sample = score;
            scores.seed = request.seed;
        }
        if request.record {
            keep(&scores)?;
        }
    }
    println!("\nthe kept list: {} faults", chosen.len());
    let copies = copies()?;
    run_without(&copies, &chosen)?;
    let (score, unseen) = plant(&copies, &chosen)?;
    scores.kept = score;
    if request.record {
        keep(&scores)?;
    }
    for name in &unseen {
        println!("not caught: {name}");
    }
    println!("kept list: {} of {} caught", score.caught, score.tried);
    match unseen.is_empty() {
        true => Ok(()),
        false => Err(Error::silent(1)),
    }
}

/// What is kept of the last runs, in a line for `test`.
pub fn summary() -> String {
    let Scores { sample, kept, .. } = recorded();
    format!(
        "planted faults caught when last measured (cargo xtask mutants --record): {} of {} in a sample, {} of {} of the kept list",
        sample.caught, sample.tried, kept.caught, kept.tried
    )
}

fn keep(scores: &Scores) -> Result<(), Error> {
    let path = repo::root().join(KEPT);
    let text = serde_json::to_string_pretty(scores).expect("plain numbers") + "\n";
    fs::write(&path, text).map_err(|error| Error::io(path.display(), error))
}

fn recorded() -> Scores {
    fs::read_to_string(repo::root().join(KEPT))
        .ok()
        .and_then(|text| serde_json::from_str(&text).ok())
        .unwrap_or_default()
}

/// Plants those whose tests the host alone runs. `Ok` if each is caught; else the names.
///
/// # Errors
/// The names of those that were not caught, or what else was wrong.
pub fn plant_on_host() -> Result<usize, Error> {
    let faults = planted::load(repo::root())?;
    let on_host: Vec<_> = faults
        .into_iter()
        .filter(|fault| fault.test.is_on_host())
        .collect();
    // `test` has just run the tests without a fault.
    let (score, unseen) = plant(&copies()?, &on_host)?;
    match unseen.is_empty() {
        true => Ok(score.tried),
        false => Err(Error::failed(format!("not caught: {}", unseen.join("; ")))),
    }
}

fn copies() -> Result<Vec<Copy>, Error> {
    (0..AT_A_TIME).map(Copy::new).collect()
}

/// Runs the tests of these faults without any: one that fails anyway sees nothing.
fn run_without(copies: &[Copy], faults: &[Fault]) -> Result<(), Error> {
    let tests: BTreeSet<_> = faults.iter().map(|fault| fault.test.clone()).collect();
    let tests: Vec<_> = tests.into_iter().collect();
    let broken = side_by_side(copies, &tests, |copy, test| {
        let verdict = copy.run(test)?;
        Ok((verdict != Verdict::Passed).then(|| format!("{test:?}: {verdict:?} without a fault")))
    })?;
    match broken.is_empty() {
        true => Ok(()),
        false => Err(Error::failed(broken.join("\n"))),
    }
}

/// Plants each, and gives the names of those that no test saw.
fn plant(copies: &[Copy], faults: &[Fault]) -> Result<(Score, Vec<String>), Error> {
    let unseen = side_by_side(copies, faults, |copy, fault| {
        let verdict = copy.try_fault(fault)?;
        println!("{verdict:?}: {}", fault.name);
        let caught = matches!(verdict, Verdict::Failed | Verdict::Hung);
        Ok((!caught).then(|| format!("{} ({verdict:?})", fault.name)))
    })?;
    let score = Score {
        caught: faults.len() - unseen.len(),
        tried: faults.len(),
    };
    Ok((score, unseen))
}

/// Does each of `work` in one of the copies; what it gives is collected.
fn side_by_side<T: Sync>(
    copies: &[Copy],
    work: &[T],
    does: impl Fn(&Copy, &T) -> Result<Option<String>, Error> + Sync,
) -> Result<Vec<String>, Error> {
    let next = AtomicUsize::new(0);
    let said = Mutex::new(Vec::new());
    let failure = Mutex::new(None);
    std::thread::scope(|scope| {
        for copy in copies {
            scope.spawn(|| {
                while let Some(item) = work.get(next.fetch_add(1, Ordering::Relaxed)) {
                    match does(copy, item) {
                        Ok(text) => said.lock().expect("no panic").extend(text),
                        Err(error) => {
                            *failure.lock().expect("no panic") = Some(error);
                            return;
                        }
                    }
                }
            });
        }
    });
    match failure.into_inner().expect("no panic") {
        Some(error) => Err(error),
        None => Ok(said.into_inner().expect("no panic")),
    }
}
