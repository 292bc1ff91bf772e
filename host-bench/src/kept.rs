//! The figures kept in the repository, by compiler.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::Trouble;

/// Figures by name. The unit is the end of the name.
pub type Set = BTreeMap<String, u64>;

/// By how much a figure may differ from what is kept, in percent: copying memory is the C library's, which is not the same
/// on every machine.
const TOLERANCE_PERCENT: u64 = 2;

/// What is kept of one compiler.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Kept {
    compiler: String,
    figures: Set,
}

fn load(path: &Path) -> Result<Vec<Kept>, Trouble> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    let text = fs::read_to_string(path).map_err(|error| told(path, &error))?;
    serde_json::from_str(&text).map_err(|error| told(path, &error))
}

fn save(path: &Path, contents: &impl Serialize) -> Result<(), Trouble> {
    let text = serde_json::to_string_pretty(contents)?;
    fs::write(path, text + "\n").map_err(|error| told(path, &error))
}

fn told(path: &Path, error: &dyn std::error::Error) -> Trouble {
    format!("{}: {error}", path.display()).into()
}

/// Adds the figures to a file that holds others.
pub fn add_to(path: &Path, figures: &Set) -> Result<(), Trouble> {
    let text = fs::read_to_string(path).map_err(|error| told(path, &error))?;
    let mut all: serde_json::Value =
        serde_json::from_str(&text).map_err(|error| told(path, &error))?;
    all["host"] = serde_json::to_value(figures)?;
    save(path, &all)
}

/// Keeps these figures in place of those of the same compiler.
pub fn record(path: &Path, compiler: &str, figures: &Set) -> Result<(), Trouble> {
    let mut all = load(path)?;
    all.retain(|kept| kept.compiler != compiler);
    all.push(Kept {
        compiler: compiler.to_owned(),
        figures: figures.clone(),
    });
    all.sort_by(|a, b| a.compiler.cmp(&b.compiler));
    save(path, &all)?;
    println!("recorded in {}", path.display());
    Ok(())
}

/// Compares with what is kept and gives whether each figure is as it was: nothing where none of this compiler are kept.
pub fn compare(path: &Path, compiler: &str, figures: &Set) -> Result<Vec<bool>, Trouble> {
    println!("\nFigures kept in {}", path.display());
    let all = load(path)?;
    let Some(kept) = all.iter().find(|kept| kept.compiler == compiler) else {
        println!("  NOT COMPARED: none are kept of {compiler}");
        return Ok(Vec::new());
    };
    let verdict = |(name, is): (&String, &u64)| {
        let was = kept.figures.get(name).copied().unwrap_or(0);
        let same = is.abs_diff(was) * 100 <= was * TOLERANCE_PERCENT;
        let word = if same { "ok     " } else { "CHANGED" };
        println!("  {word}  {name}: kept {was}, measured {is}");
        same
    };
    Ok(figures.iter().map(verdict).collect())
}
