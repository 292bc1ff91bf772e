//! The kept list of planted faults: each is a change of one file, with the test that must fail.

use crate::error::Error;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// The folder of the lists, from the root of the repository.
pub const FOLDER: &str = "tests/planted";

/// One planted fault.
#[derive(Clone, Debug, Deserialize, PartialEq, Eq)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// The fault in a few words, unique in the list.
    pub name: String,
    /// The file that is changed, from the root of the repository.
    pub file: PathBuf,
    /// The old text, which must occur exactly once, so that the fault survives a move to other lines.
    pub old: String,
    /// The text that replaces it.
    pub new: String,
    /// The test that must fail.
    pub test: Test,
}

/// Tests as cargo names them.
#[derive(Clone, Debug, Deserialize, PartialEq, Eq, PartialOrd, Ord)]
#[serde(deny_unknown_fields)]
pub struct Test {
    /// The package of the test.
    pub package: String,
    /// The file below `tests/`, without `.rs`; without it the unit tests of the library.
    pub target: Option<String>,
    /// The name of the test, or a part of several names.
    pub name: String,
}

/// The content of one file of the list.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    fault: Vec<Fault>,
}

impl Test {
    /// Whether the test runs on the host alone: no firmware image, no simulator.
    pub fn is_on_host(&self) -> bool {
        !crate::repo::SIMULATED.contains(&self.package.as_str())
    }
}

/// All faults of the list below `root`, in the order of file names.
///
/// # Errors
/// [`Error::failed`] for a file that cannot be read or parsed, two faults with one name, and a fault that no longer
/// applies; the message names the fault and the rule.
pub fn load(root: &Path) -> Result<Vec<Fault>, Error> {
    let folder = root.join(FOLDER);
    let entries = fs::read_dir(&folder).map_err(|error| Error::io(folder.display(), error))?;
    let mut files: Vec<_> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "toml")
        })
        .collect();
    files.sort();
    let mut faults = Vec::new();
    for file in files {
        let text = fs::read_to_string(&file).map_err(|error| Error::io(file.display(), error))?;
        faults.extend(
            parse(&text).map_err(|error| Error::failed(format!("{}: {error}", file.display())))?,
        );
    }
    let mut names = BTreeSet::new();
    for fault in &faults {
        if !names.insert(&fault.name) {
            return Err(Error::failed(format!(
                "planted fault \"{}\" is there twice, each name must be there once",
                fault.name
            )));
        }
        let path = root.join(&fault.file);
        let text = fs::read_to_string(&path).map_err(|error| Error::io(path.display(), error))?;
        planted(fault, &text)?;
    }
    Ok(faults)
}

fn parse(text: &str) -> Result<Vec<Fault>, toml::de::Error> {
    toml::from_str::<List>(text).map(|list| list.fault)
}

/// `text` with the fault in it.
///
/// # Errors
/// [`Error::failed`] unless the old text occurs exactly once and differs from the new text.
pub fn planted(fault: &Fault, text: &str) -> Result<String, Error> {
    let wrong = |what: String| {
        Err(Error::failed(format!(
            "planted fault \"{}\": {what} in {}",
            fault.name,
            fault.file.display()
        )))
    };
    match text.matches(&fault.old).count() {
        _ if fault.old == fault.new => {
            wrong("old and new are the same text, must differ".to_owned())
        }
        1 => Ok(text.replacen(&fault.old, &fault.new, 1)),
        count => wrong(format!(
            "the old text stands {count} times, must stand once"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIST: &str = r#"
        [[fault]]
        name = "one too many"
        file = "src/a.rs"
        old = "a < b"
        new = "a <= b"
        test = { package = "p", target = "t", name = "n" }
    "#;

    fn fault() -> Fault {
        parse(LIST).expect("a list").remove(0)
    }

    #[test]
    fn a_fault_goes_where_its_old_text_stands_and_nowhere_else() {
        let text = "if a < b {}\n";
        assert_eq!(
            planted(&fault(), text).ok().as_deref(),
            Some("if a <= b {}\n")
        );
        for (text, said) in [
            ("", "stands 0 times, must stand once in src/a.rs"),
            ("a < b, a < b", "stands 2 times"),
        ] {
            let error = planted(&fault(), text).expect_err("no single place");
            assert!(error.message().contains(said), "{}", error.message());
            assert!(error.message().contains("one too many"));
        }
        let same = Fault {
            new: "a < b".to_owned(),
            ..fault()
        };
        assert!(planted(&same, text).is_err());
    }

    #[test]
    fn a_wrong_word_in_the_list_is_reported() {
        let text = LIST.replace("old =", "odl =");
        let error = parse(&text).expect_err("no such field").to_string();
        assert!(error.contains("odl"), "{error}");
    }

    #[test]
    fn the_kept_list_applies() {
        let faults =
            load(crate::repo::root()).unwrap_or_else(|error| panic!("{}", error.message()));
        assert!(!faults.is_empty());
    }
}
