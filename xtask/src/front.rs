//! The first program of a user is short: how many lines of code each may have.

use crate::error::Error;
use crate::repo;
use crate::tally::Tally;
use std::fs;
use std::path::Path;

/// Programs, and how many lines of code they may have.
const LIMITS: [(&str, usize); 7] = [
    ("board-nano/src/bin/demo-unit.rs", 25),
    ("board-nano/src/bin/registers.rs", 25),
    ("board-nano/examples/client.rs", 25),
    ("board-stm32/src/bin/demo-unit.rs", 25),
    ("board-stm32/src/bin/registers.rs", 25),
    ("board-stm32/examples/client.rs", 25),
    ("board-stm32/src/bin/ports.rs", 119),
];

/// The longest line that counts as one: rustfmt's, which leaves the inside of macros alone.
const WIDTH: usize = 100;

/// Says what is wrong with the programs below `root`: one line for each fault.
///
/// # Errors
/// [`Error::failed`] when a program cannot be read.
pub fn check(root: &Path) -> Result<Vec<String>, Error> {
    let mut faults = Vec::new();
    for (path, limit) in LIMITS {
        let source = fs::read_to_string(root.join(path))
            .map_err(|error| Error::failed(format!("{path}: {error}")))?;
        faults.extend(judge(path, &source, limit));
    }
    Ok(faults)
}

/// Checks the programs of the repository.
pub fn run(tally: &mut Tally) {
    tally.faults("lines of the first programs", check(repo::root()));
}

/// The faults of one program. Blank lines and comments do not count.
fn judge(path: &str, source: &str, limit: usize) -> Vec<String> {
    let is_code = |line: &&str| !line.trim().is_empty() && !line.trim_start().starts_with("//");
    let code: Vec<&str> = source.lines().filter(is_code).collect();
    let mut faults = Vec::new();
    if code.len() > limit {
        let count = code.len();
        faults.push(format!(
            "{path}: {count} lines of code, must be {limit} or fewer"
        ));
    }
    for line in code.iter().filter(|line| line.chars().count() > WIDTH) {
        faults.push(format!(
            "{path}: a line is longer than {WIDTH}: {}",
            line.trim()
        ));
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blank_lines_and_comments_do_not_count() {
        let source = "//! A program.\n\nuse a;\n\n/// Runs.\nfn main() {\n    // Nothing.\n}\n";
        assert_eq!(judge("a.rs", source, 3), [""; 0]);
        let faults = judge("a.rs", source, 2);
        assert_eq!(faults, ["a.rs: 3 lines of code, must be 2 or fewer"]);
    }

    #[test]
    fn lines_that_are_too_long_are_told() {
        let line = format!("use {};", "a".repeat(WIDTH - 5));
        assert_eq!(judge("a.rs", &line, 1), [""; 0]);
        let line = format!("use {};", "a".repeat(WIDTH - 4));
        let faults = judge("a.rs", &line, 1);
        assert_eq!(faults, [format!("a.rs: a line is longer than 100: {line}")]);
    }

    #[test]
    fn a_program_that_is_missing_is_an_error() {
        assert!(check(Path::new("/nowhere")).is_err());
    }
}
