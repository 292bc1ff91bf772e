//! The dependencies that a crate may have: none on a layer above it.

use crate::error::Error;
use crate::repo;
use crate::tally::Tally;
use std::fs;
use std::path::Path;
use toml::{Table, Value};

/// A manifest, and what it must not depend on.
const RULES: [(&str, &str); 3] = [
    ("board-nano/embassy-avr-hal/Cargo.toml", "multidrop"),
    ("board-nano/embassy-avr-hal/Cargo.toml", "multidrop-apps"),
    ("protocol/Cargo.toml", "multidrop"),
];

/// Counts the check of all manifests.
pub fn run(tally: &mut Tally) {
    tally.faults("layers: what crates depend on", check(repo::root()));
}

fn check(root: &Path) -> Result<Vec<String>, Error> {
    let mut faults = Vec::new();
    for (path, forbidden) in RULES {
        let wrong = |error: &dyn std::fmt::Display| Error::failed(format!("{path}: {error}"));
        let text = fs::read_to_string(root.join(path)).map_err(|error| wrong(&error))?;
        let manifest = text.parse::<Table>().map_err(|error| wrong(&error))?;
        if depends(&manifest, forbidden) {
            faults.push(format!("{path}: it must not depend on `{forbidden}`"));
        }
    }
    Ok(faults)
}

/// Whether a manifest names the package in any of its tables of dependencies, be it by another name or for one target only.
fn depends(manifest: &Table, package: &str) -> bool {
    manifest.iter().any(|(key, value)| match value {
        Value::Table(table) if key.ends_with("dependencies") => {
            table.iter().any(|(name, dependency)| {
                let renamed = dependency.get("package").and_then(Value::as_str);
                renamed.unwrap_or(name) == package
            })
        }
        Value::Table(table) => depends(table, package),
        _ => false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names_multidrop(text: &str) -> bool {
        depends(&text.parse().unwrap(), "multidrop")
    }

    #[test]
    fn a_dependency_is_found_in_every_table_and_by_every_name() {
        for text in [
            "[dependencies]\nmultidrop = { path = \"../firmware\" }",
            "[dependencies.multidrop]\nversion = \"0.1\"",
            "[dev-dependencies]\nmultidrop = \"0.1\"",
            "[build-dependencies]\nline = { package = \"multidrop\", version = \"0.1\" }",
            "[target.'cfg(target_arch = \"avr\")'.dependencies]\nmultidrop = \"0.1\"",
        ] {
            assert!(names_multidrop(text), "{text}");
        }
    }

    #[test]
    fn another_package_is_not_taken_for_it() {
        for text in [
            "[package]\nname = \"multidrop\"",
            "[dependencies]\nmultidrop-protocol = \"0.1\"",
            "[dependencies]\nmultidrop = { package = \"other\", version = \"0.1\" }",
        ] {
            assert!(!names_multidrop(text), "{text}");
        }
    }

    #[test]
    fn the_crates_keep_to_it() {
        assert_eq!(check(crate::repo::root()).unwrap(), Vec::<String>::new());
    }
}
