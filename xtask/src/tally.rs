//! Counting checks and tests, whatever tool runs them.

use crate::error::Error;
use std::fmt;

/// How many passed and failed, which failed, and which were skipped.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Tally {
    passed: usize,
    failed: usize,
    failures: Vec<String>,
    skipped: Vec<String>,
}

/// What the summary of a tool's output says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Tests that passed.
    pub passed: usize,
    /// Tests that failed.
    pub failed: usize,
}

impl Tally {
    /// Adds one check.
    pub fn check(&mut self, name: &str, passed: bool) {
        self.tool(
            name,
            passed,
            Counts {
                passed: usize::from(passed),
                failed: usize::from(!passed),
            },
        );
    }

    /// Prints the faults that a check of the repository has found, and counts the check as passed if there are none.
    pub fn faults(&mut self, name: &str, found: Result<Vec<String>, Error>) {
        let faults = found.unwrap_or_else(|error| vec![error.message().to_owned()]);
        for fault in &faults {
            println!("{fault}");
        }
        self.check(name, faults.is_empty());
    }

    /// Adds the tests that a tool ran. A tool that failed and counts no failure (its tests did not
    /// even compile), or that succeeded and ran nothing, is a failure itself.
    pub fn tool(&mut self, name: &str, succeeded: bool, counts: Counts) {
        let silent_failure = !succeeded && counts.failed == 0;
        let nothing_ran = succeeded && counts == Counts::default();
        self.passed += counts.passed;
        self.failed += counts.failed;
        if silent_failure || nothing_ran {
            self.failed += 1;
        }
        if nothing_ran {
            self.failures.push(format!("{name}: no test was run"));
        } else if !succeeded || counts.failed > 0 {
            self.failures.push(format!("{name}: failed"));
        }
    }

    /// Adds a check that was not made, and why. It has neither passed nor failed.
    pub fn skip(&mut self, name: &str, why: &str) {
        println!("{name} is skipped: {why}");
        self.skipped.push(format!("{name}: skipped, {why}"));
    }

    /// Whether nothing failed.
    pub fn is_good(&self) -> bool {
        self.failed == 0
    }
}

/// What was skipped and what failed, one a line, and the counts on the last line.
impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for line in self.skipped.iter().chain(&self.failures) {
            writeln!(f, "{line}")?;
        }
        write!(f, "{} passed, {} failed", self.passed, self.failed)
    }
}

impl Counts {
    /// Takes in a line of what Rust's test harness prints: its summary is `test result: ok. 5
    /// passed; 0 failed; ...`, one for each test binary.
    pub fn take_rust(&mut self, line: &str) {
        if let Some((_, summary)) = line.split_once("test result: ") {
            self.passed += number_before(summary, " passed").unwrap_or(0);
            self.failed += number_before(summary, " failed").unwrap_or(0);
        }
    }

    /// Takes in a line of what Python's unittest prints: `Ran 5 tests in 1.2s`, then `OK` or
    /// `FAILED (failures=1, errors=1)`. A skipped test has not passed.
    pub fn take_python(&mut self, line: &str) {
        if let Some(ran) = line.strip_prefix("Ran ") {
            self.passed += number_before(ran, " test").unwrap_or(0);
        } else if line.starts_with("FAILED (") || line.starts_with("OK (") {
            let bad = ["failures=", "errors="]
                .map(|key| number_after(line, key))
                .iter()
                .sum::<usize>();
            let not_passed = bad + number_after(line, "skipped=");
            // An error in the set-up of a class is counted although its tests did not run.
            self.passed = self.passed.saturating_sub(not_passed);
            self.failed += bad;
        }
    }
}

fn number_before(text: &str, unit: &str) -> Option<usize> {
    let (before, _) = text.split_once(unit)?;
    before.split_whitespace().next_back()?.parse().ok()
}

fn number_after(text: &str, key: &str) -> usize {
    text.split_once(key)
        .map(|(_, rest)| rest.chars().take_while(char::is_ascii_digit).collect())
        .and_then(|digits: String| digits.parse().ok())
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(lines: &[&str], take: fn(&mut Counts, &str)) -> (usize, usize) {
        let mut counts = Counts::default();
        for line in lines {
            take(&mut counts, line);
        }
        (counts.passed, counts.failed)
    }

    #[test]
    fn the_summaries_of_all_test_binaries_are_added() {
        let lines = [
            "running 2 tests",
            "test a ... ok",
            "test result: ok. 2 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out",
            "test result: FAILED. 10 passed; 3 failed; 0 ignored; 0 measured; 0 filtered out",
        ];
        assert_eq!(counts(&lines, Counts::take_rust), (12, 3));
    }

    #[test]
    fn pythons_failures_errors_and_skipped_tests_have_not_passed() {
        let good = ["Ran 5 tests in 0.1s", "", "OK"];
        assert_eq!(counts(&good, Counts::take_python), (5, 0));
        let bad = [
            "Ran 9 tests in 1.0s",
            "FAILED (failures=1, errors=2, skipped=1)",
        ];
        assert_eq!(counts(&bad, Counts::take_python), (5, 3));
        let class = ["Ran 0 tests in 0.0s", "FAILED (errors=1)"];
        assert_eq!(counts(&class, Counts::take_python), (0, 1));
    }

    #[test]
    fn what_is_skipped_is_told_by_name_and_not_counted() {
        let mut tally = Tally::default();
        tally.check("format", true);
        tally.skip("guide", "no mdbook");
        assert!(tally.is_good());
        assert_eq!(
            tally.to_string(),
            "guide: skipped, no mdbook\n1 passed, 0 failed"
        );
    }

    #[test]
    fn a_tool_that_fails_without_a_count_or_runs_nothing_is_a_failure() {
        let mut tally = Tally::default();
        tally.check("format", true);
        tally.tool("unit tests", false, Counts::default());
        tally.tool("python", true, Counts::default());
        assert!(!tally.is_good());
        assert_eq!(
            tally.to_string(),
            "unit tests: failed\npython: no test was run\n1 passed, 2 failed"
        );
    }

    #[test]
    fn a_check_passes_only_without_a_fault() {
        let counted = |found| {
            let mut tally = Tally::default();
            tally.faults("a check", found);
            tally.is_good()
        };
        assert!(counted(Ok(Vec::new())));
        assert!(!counted(Ok(vec!["a fault".to_owned()])));
        assert!(!counted(Err(Error::failed("no such file"))));
    }
}
