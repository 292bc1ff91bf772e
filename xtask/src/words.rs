//! The words of doc comments: each names what it documents. An opening such as `The same` has no antecedent in rustdoc's index,
//! and one or two words say nothing that the name does not.

use crate::error::Error;
use crate::tally::Tally;
use crate::{guide, repo};
use std::fs;
use std::path::Path;

/// Openings that refer to a text which is not there, or that begin a fragment.
const OPENINGS: [&str; 13] = [
    "The same",
    "Same",
    "As above",
    "As [",
    "Likewise",
    "Which",
    "Whose",
    "All there",
    "So many",
    "See [",
    "For [",
    "Of [",
    "Of those",
];
/// The fewest words of a doc comment's first paragraph.
const WORDS_MIN: usize = 3;

/// Checks the doc comments of all Rust files below `root`: one line for each fault, with file and line.
///
/// # Errors
/// [`Error::failed`] when a file cannot be read.
pub fn check(root: &Path) -> Result<Vec<String>, Error> {
    let mut faults = Vec::new();
    for path in guide::sources(root)? {
        let source = fs::read_to_string(root.join(&path))
            .map_err(|error| Error::failed(format!("{}: {error}", path.display())))?;
        for (line, what) in wrong(&source) {
            faults.push(format!("{}:{line}: {what}", path.display()));
        }
    }
    Ok(faults)
}

/// Checks the doc comments of the repository.
pub fn run(tally: &mut Tally) {
    tally.faults("words of doc comments", check(repo::root()));
}

/// The lines of doc comments with a wrong beginning, and what is wrong.
fn wrong(source: &str) -> Vec<(usize, String)> {
    first_paragraphs(source)
        .into_iter()
        .filter_map(|(line, text)| Some((line, fault(text.trim())?)))
        .collect()
}

/// The fault of a first paragraph, if there is one.
fn fault(text: &str) -> Option<String> {
    let begins_with = |opening: &&&str| {
        text.strip_prefix(**opening)
            .is_some_and(|rest| opening.ends_with('[') || !rest.starts_with(char::is_alphanumeric))
    };
    if let Some(opening) = OPENINGS.iter().find(begins_with) {
        return Some(format!(
            "a doc comment begins with `{opening}`: name what it documents"
        ));
    }
    // A section follows text from a macro or an attribute.
    let is_section = text.starts_with("# ");
    let is_fragment = !is_section && text.split_whitespace().count() < WORDS_MIN;
    is_fragment
        .then(|| format!("the doc comment `{text}` is a fragment: use {WORDS_MIN} words or more"))
}

/// The first paragraph of each doc comment, with the line where it begins.
fn first_paragraphs(source: &str) -> Vec<(usize, String)> {
    let mut found: Vec<(usize, String)> = Vec::new();
    let mut before = None;
    let mut is_open = false;
    for (index, line) in source.lines().enumerate() {
        let doc = doc(line);
        let marker = doc.map(|(marker, _)| marker);
        match doc {
            Some((_, text)) if marker != before => {
                found.push((index + 1, text.to_owned()));
                is_open = true;
            }
            Some((_, "")) => is_open = false,
            Some((_, text)) if is_open => {
                if let Some((_, paragraph)) = found.last_mut() {
                    paragraph.push(' ');
                    paragraph.push_str(text);
                }
            }
            _ => {}
        }
        before = marker;
    }
    found
}

/// The marker and the text of a line of a doc comment.
fn doc(line: &str) -> Option<(&'static str, &str)> {
    let line = line.trim_start();
    ["///", "//!"].into_iter().find_map(|marker| {
        let text = line.strip_prefix(marker)?;
        (!text.starts_with('/')).then_some((marker, text.trim()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(source: &str) -> Vec<usize> {
        wrong(source).into_iter().map(|(line, _)| line).collect()
    }

    #[test]
    fn the_doc_comments_of_this_repository_name_their_subjects() {
        assert_eq!(check(repo::root()).expect("readable files"), [""; 0]);
    }

    #[test]
    fn a_doc_comment_that_names_its_subject_is_right() {
        let source = "//! The bus and its nodes.\n\n/// The number of\n/// nodes.\nfn nodes() {}\n";
        assert_eq!(wrong(source), []);
    }

    #[test]
    fn an_opening_without_antecedent_is_a_fault_with_its_line() {
        for opening in OPENINGS {
            let source =
                format!("fn one() {{}}\n    /// {opening} x with other times.\nfn two() {{}}\n");
            let found = wrong(&source);
            assert_eq!(found.len(), 1, "{opening}");
            assert_eq!(found[0].0, 2);
            assert!(found[0].1.contains(opening), "{}", found[0].1);
        }
        assert_eq!(lines("//! The same, on every board.\n"), [1]);
        assert_eq!(lines("/// Whichever comes first ends it.\n"), [0; 0]);
    }

    #[test]
    fn one_or_two_words_are_a_fault() {
        assert_eq!(lines("/// Which.\nx: u8,\n/// Parity.\ny: u8,\n"), [1, 3]);
        assert_eq!(lines("/// The bytes.\n"), [1]);
        assert_eq!(lines("/// Bits per\n/// second.\n"), [0; 0]);
        assert_eq!(lines("///\n/// # Panics\n/// At compile time.\n"), [0; 0]);
    }

    #[test]
    fn only_the_first_paragraph_counts() {
        assert_eq!(
            lines("/// The port of it.\n///\n/// The same port.\n/// Panics.\n"),
            [0; 0]
        );
        assert_eq!(
            lines("/// Now.\n///\n/// More words in a second paragraph.\n"),
            [1]
        );
    }

    #[test]
    fn other_comments_and_strings_are_not_looked_at() {
        assert_eq!(lines("// Now.\n//// Now.\nlet x = \"/// Now.\";\n"), [0; 0]);
    }
}
