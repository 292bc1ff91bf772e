//! Copies of the repository in which faults are planted, two at a time, with what was built of them before.

use super::planted::{Fault, Test, planted};
use crate::error::Error;
use crate::{job, repo};
use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// The time limit of a test with a fault in it, apart from building.
const PATIENCE: Duration = Duration::from_secs(600);

/// The folders that set-up has made below `target/`: the copies share them.
const SHARED: [&str; 2] = ["python", "qemu"];

/// One copy of the repository.
pub struct Copy {
    folder: PathBuf,
}

/// The result of a test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The test was built, run, and passed.
    Passed,
    /// The test was built, run, and failed.
    Failed,
    /// The test did not end.
    Hung,
    /// The test was not built, or no test has that name.
    NotRun,
}

impl Copy {
    /// The copy with this number, of the work tree as it is now. Earlier build results are kept.
    ///
    /// # Errors
    /// [`Error::failed`] where a file cannot be read or written.
    pub fn new(number: usize) -> Result<Self, Error> {
        let folder = repo::root().join(format!("target/mutants/copy-{number}"));
        let target = folder.join("target");
        fs::create_dir_all(&target).map_err(|error| Error::io(target.display(), error))?;
        for shared in SHARED {
            let (from, link) = (
                repo::root().join("target").join(shared),
                target.join(shared),
            );
            if from.exists() && !link.exists() {
                symlink(&from, &link).map_err(|error| Error::io(link.display(), error))?;
            }
        }
        let copy = Self { folder };
        copy.refresh()?;
        Ok(copy)
    }

    /// Makes every file equal to that of the work tree. A file that is equal already keeps its date, so it is not
    /// built again.
    fn refresh(&self) -> Result<(), Error> {
        let files = listed(repo::root())?;
        for file in &files {
            let (from, to) = (repo::root().join(file), self.folder.join(file));
            let contents = fs::read(&from).map_err(|error| Error::io(from.display(), error))?;
            if fs::read(&to).is_ok_and(|old| old == contents) {
                continue;
            }
            let parent = to.parent().expect("a file in a folder");
            fs::create_dir_all(parent).map_err(|error| Error::io(parent.display(), error))?;
            fs::copy(&from, &to).map_err(|error| Error::io(to.display(), error))?;
        }
        let mut there = Vec::new();
        crate::firmware::collect_files(&self.folder, &mut there)
            .map_err(|error| Error::io(self.folder.display(), error))?;
        for path in there {
            let known = path
                .strip_prefix(&self.folder)
                .is_ok_and(|file| files.contains(file));
            if !known {
                fs::remove_file(&path).map_err(|error| Error::io(path.display(), error))?;
            }
        }
        Ok(())
    }

    /// Runs a test with this fault planted, and takes the fault out again.
    ///
    /// # Errors
    /// [`Error::failed`] where the fault does not apply, or a file cannot be written.
    pub fn try_fault(&self, fault: &Fault) -> Result<Verdict, Error> {
        let path = self.folder.join(&fault.file);
        let text = fs::read_to_string(&path).map_err(|error| Error::io(path.display(), error))?;
        let write =
            |text: &str| fs::write(&path, text).map_err(|error| Error::io(path.display(), error));
        write(&planted(fault, &text)?)?;
        let verdict = self.run(&fault.test);
        write(&text)?;
        verdict
    }

    /// Runs a test.
    ///
    /// # Errors
    /// [`Error::failed`] where cargo cannot be started; and as [`job::check`].
    pub fn run(&self, test: &Test) -> Result<Verdict, Error> {
        let mut cargo = repo::cargo();
        cargo
            .current_dir(&self.folder)
            // A folder that the copies share would have what was built of the other one.
            .env_remove("CARGO_TARGET_DIR")
            .args(["test", "--package", &test.package])
            .stdin(Stdio::null())
            .stderr(Stdio::null());
        if !test.is_on_host() {
            cargo.arg("--release");
            // This builds a fault in the simulated bus in 2 s instead of 14. It is an argument, so that the images do
            // not change.
            cargo.args(["--config", "profile.release.incremental=true"]);
        }
        match &test.target {
            Some(target) => cargo.args(["--test", target]),
            None => cargo.arg("--lib"),
        };
        cargo.arg(&test.name);
        let (status, printed) = job::output_within(&mut cargo, PATIENCE)?;
        Ok(match status {
            None => Verdict::Hung,
            Some(status) => verdict(status.success(), &printed),
        })
    }
}

/// The verdict from cargo's exit status and output.
fn verdict(succeeded: bool, printed: &str) -> Verdict {
    if printed.contains("test result: FAILED") {
        Verdict::Failed
    } else if succeeded && !printed.contains("test result: ok. 0 passed") {
        Verdict::Passed
    } else if !succeeded && printed.contains("\nrunning ") && !printed.contains("test result: ok") {
        // The whole process has ended, for example by an abort.
        Verdict::Failed
    } else {
        Verdict::NotRun
    }
}

/// Every file that git tracks or would add, from `root`.
fn listed(root: &Path) -> Result<BTreeSet<PathBuf>, Error> {
    let output = Command::new("git")
        .current_dir(root)
        .args([
            "ls-files",
            "-z",
            "--cached",
            "--others",
            "--exclude-standard",
        ])
        .output()
        .map_err(|error| Error::io("git", error))?;
    if !output.status.success() {
        return Err(Error::failed(
            "git ls-files failed: mutants need a checkout",
        ));
    }
    let names = String::from_utf8_lossy(&output.stdout);
    let files = names.split('\0').filter(|name| !name.is_empty());
    Ok(files
        .map(PathBuf::from)
        .filter(|file| root.join(file).is_file())
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_test_that_ran_counts() {
        for (succeeded, printed, expected) in [
            (
                true,
                "\nrunning 1 test\ntest result: ok. 1 passed; 0 failed",
                Verdict::Passed,
            ),
            (
                true,
                "\nrunning 0 tests\ntest result: ok. 0 passed; 0 failed",
                Verdict::NotRun,
            ),
            (
                false,
                "\nrunning 2 tests\ntest result: FAILED. 1 passed; 1 failed",
                Verdict::Failed,
            ),
            (false, "\nrunning 1 test\n", Verdict::Failed),
            (false, "error[E0308]: mismatched types", Verdict::NotRun),
        ] {
            assert_eq!(verdict(succeeded, printed), expected, "{printed}");
        }
    }
}
