//! How the repository is divided: no source is long, and none takes files of another crate by their path.

use crate::error::Error;
use crate::guide::collect;
use crate::repo;
use crate::tally::Tally;
use std::fs;
use std::path::{Component, Path, PathBuf};

/// Lines that a source may have.
const LINES: usize = 500;

/// What a file is taken by, up to its path.
const TAKEN_BY: [&str; 4] = [
    "#[path = \"",
    "include!(\"",
    "include_str!(\"",
    "include_bytes!(\"",
];

/// Checks all sources in Rust below `root`, and says what is wrong with them: one line for each fault.
///
/// # Errors
/// [`Error::failed`] when a source cannot be read.
pub fn check(root: &Path) -> Result<Vec<String>, Error> {
    let mut sources = Vec::new();
    collect(root, Path::new(""), "rs", &mut sources)?;
    sources.sort();
    let mut faults = Vec::new();
    for source in sources {
        let path = root.join(&source);
        let text = fs::read_to_string(&path).map_err(|error| Error::io(path.display(), error))?;
        let count = text.lines().count();
        if count > LINES {
            faults.push(format!(
                "{}: {count} lines, must be {LINES} or fewer: split it into modules",
                source.display()
            ));
        }
        for (index, line) in text.lines().enumerate() {
            if let Some(taken) = taken(line)
                && crate_of(root, &source) != crate_of(root, &beside(&source, taken))
            {
                faults.push(format!(
                    "{}:{}: {taken} is not of this crate: make it a dependency",
                    source.display(),
                    index + 1
                ));
            }
        }
    }
    Ok(faults)
}

/// Checks the sources of the repository.
pub fn run(tally: &mut Tally) {
    tally.faults("length and paths of all sources", check(repo::root()));
}

/// The path of the file that a line takes.
fn taken(line: &str) -> Option<&str> {
    let by = |start: &&str| Some(line.split_once(*start)?.1);
    TAKEN_BY
        .iter()
        .find_map(by)?
        .split_once('"')
        .map(|(path, _)| path)
}

/// `path` as a source names it, from the root of the repository.
fn beside(source: &Path, path: &str) -> PathBuf {
    let mut whole = source.parent().unwrap_or(Path::new("")).to_path_buf();
    for component in Path::new(path).components() {
        match component {
            Component::ParentDir => {
                // Above the root is no crate of ours.
                if !whole.pop() {
                    return PathBuf::from("..");
                }
            }
            Component::CurDir => {}
            other => whole.push(other),
        }
    }
    whole
}

/// The folder of the crate that a file belongs to: the nearest above it with a manifest.
fn crate_of<'a>(root: &Path, file: &'a Path) -> Option<&'a Path> {
    let mut above = file.ancestors().skip(1);
    above.find(|folder| root.join(folder).join("Cargo.toml").is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The faults of a repository of two crates, `a` and `a/b`, with this source in `b`.
    fn faults(text: &str) -> Vec<String> {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |path: &str, text: &str| {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            fs::write(path, text).expect("written");
        };
        for manifest in ["Cargo.toml", "a/Cargo.toml", "a/b/Cargo.toml"] {
            write(manifest, "");
        }
        write("a/src/lib.rs", "");
        write("a/target/long.rs", &"\n".repeat(LINES + 1));
        write("a/b/tests/one.rs", text);
        check(folder.path()).expect("readable")
    }

    #[test]
    fn a_source_has_500_lines_and_not_one_more() {
        assert_eq!(faults(&"\n".repeat(500)), [""; 0]);
        assert_eq!(
            faults(&"\n".repeat(501)),
            ["a/b/tests/one.rs: 501 lines, must be 500 or fewer: split it into modules"]
        );
    }

    #[test]
    fn a_path_may_not_lead_out_of_its_crate() {
        for path in ["deep/two.rs", "../src/lib.rs", "./../../b/x.rs"] {
            assert_eq!(
                faults(&format!("#[path = \"{path}\"]\nmod two;\n")),
                [""; 0]
            );
        }
        for path in ["../../src/lib.rs", "../../../c.rs", "../../../../out.rs"] {
            assert_eq!(
                faults(&format!("\n    #[path = \"{path}\"]\nmod two;\n")),
                [format!(
                    "a/b/tests/one.rs:2: {path} is not of this crate: make it a dependency"
                )]
            );
        }
        for by in ["include!", "include_str!", "include_bytes!"] {
            assert_eq!(
                faults(&format!("{by}(\"../../src/lib.rs\");")).len(),
                1,
                "{by}"
            );
        }
    }

    #[test]
    fn the_repository_is_divided_so() {
        assert_eq!(check(repo::root()).expect("readable"), [""; 0]);
    }
}
