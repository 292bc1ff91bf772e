//! `mutants`: plants faults in the code, one at a time, and checks whether a test detects each.
//!
//! There are two ways. cargo-mutants changes `protocol` and `firmware` automatically: a sample, or what a revision
//! has changed. The [kept list](planted) has faults written by hand, in drivers, bus and oracles too.

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

/// The number of faults that are tried at a time: each builds with two cores.
const AT_A_TIME: usize = 2;

/// The file of the scores.
const KEPT: &str = "figures/mutants.json";

/// The faults to plant.
#[derive(Args)]
pub struct MutantsRequest {
    /// Only the kept list
    #[arg(long, conflicts_with_all = ["sample", "since"])]
    kept: bool,
    /// Only faults of the kept list whose name contains this text
    #[arg(long, value_name = "TEXT", conflicts_with_all = ["sample", "since", "record"])]
    only: Option<String>,
    /// Number of mutants of protocol and firmware [default: 100]
    #[arg(long, value_name = "N", conflicts_with = "since", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    sample: Option<u32>,
    /// The seed of the sample
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Only mutants of what has changed since this revision
    #[arg(long, value_name = "REV")]
    since: Option<String>,
    /// Record the score in figures/mutants.json
    #[arg(long)]
    record: bool,
}

/// A number of faults that were caught, of all that were tried.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Score {
    /// The number of faults for which a test failed.
    pub caught: usize,
    /// The number of faults that were tried.
    pub tried: usize,
}

/// The recorded scores of the last runs.
#[derive(Debug, Default, serde::Serialize, serde::Deserialize)]
#[serde(default)]
struct Scores {
    /// The score of cargo-mutants.
    sample: Score,
    /// The seed of the sample.
    seed: u64,
    /// The score of the kept list.
    kept: Score,
}

/// Plants the faults, and shows those that no test detected.
///
/// # Errors
/// [`Error::failed`] if a fault of the kept list was not detected or does not apply; [`Error::usage`] if
/// cargo-mutants is missing.
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

/// The recorded scores in one line, for `test`.
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

/// Plants the faults whose tests run on the host alone; returns their number if all are caught.
///
/// # Errors
/// The names of the faults that were not caught, or another error.
pub fn plant_on_host() -> Result<usize, Error> {
    let faults = planted::load(repo::root())?;
    let on_host: Vec<_> = faults
        .into_iter()
        .filter(|fault| fault.test.is_on_host())
        .collect();
    // `test` has just run these tests without a fault.
    let (score, unseen) = plant(&copies()?, &on_host)?;
    match unseen.is_empty() {
        true => Ok(score.tried),
        false => Err(Error::failed(format!("not caught: {}", unseen.join("; ")))),
    }
}

fn copies() -> Result<Vec<Copy>, Error> {
    (0..AT_A_TIME).map(Copy::new).collect()
}

/// Runs the tests of these faults without a fault: a test that fails anyway detects nothing.
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

/// Plants each fault; returns the names of those that no test detected.
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

/// Does each item of `work` in one of the copies, and collects the results.
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
