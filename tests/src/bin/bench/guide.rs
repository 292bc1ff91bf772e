//! The part of the figures that the guide shows: written with the kept file, and checked against it, so that
//! it never tells of a firmware that is gone.

use std::fs;
use std::ops::Range;
use std::path::Path;

use crate::Trouble;
use crate::board::Board;
use crate::figures::Figures;

/// The line after a table.
pub const END: &str = "<!-- end of what bench wrote -->";

/// Puts these figures there, unless those of another compiler that are still kept stand there.
pub fn update(
    path: &Path,
    board: Board,
    kept: &[Figures],
    figures: &Figures,
) -> Result<(), Trouble> {
    let mut text = read(path)?;
    let place = place(path, board, &text)?;
    let own_or_gone = shown(board, &text[place.clone()], kept).is_none();
    if own_or_gone {
        text.replace_range(place, &section(board, figures));
        fs::write(path, text).map_err(|source| file(path, source))?;
        println!("shown in {}", path.display());
    }
    Ok(())
}

/// Checks and prints whether the table shows recorded figures of some compiler.
pub fn check(path: &Path, board: Board, kept: &[Figures]) -> Result<bool, Trouble> {
    let text = read(path)?;
    let good = shown(board, &text[place(path, board, &text)?], kept).is_some();
    let verdict = if good { "ok     " } else { "CHANGED" };
    println!("  {verdict}  table in {}", path.display());
    if !good {
        println!("           it shows other figures than are kept: cargo xtask bench --record");
    }
    Ok(good)
}

/// The kept figures that the table shows.
fn shown<'a>(board: Board, text: &str, kept: &'a [Figures]) -> Option<&'a Figures> {
    kept.iter().find(|figures| section(board, figures) == text)
}

fn section(board: Board, figures: &Figures) -> String {
    format!("\n{}\n", board.table().brief(figures))
}

fn read(path: &Path) -> Result<String, Trouble> {
    fs::read_to_string(path).map_err(|source| file(path, source))
}

fn file(path: &Path, source: std::io::Error) -> Trouble {
    Trouble::File {
        path: path.to_owned(),
        source,
    }
}

/// Between the two lines.
fn place(path: &Path, board: Board, text: &str) -> Result<Range<usize>, Trouble> {
    let missing = || Trouble::NoPlace(path.to_owned(), board.begin());
    let begin = text.find(board.begin()).ok_or_else(missing)? + board.begin().len() + 1;
    let rest = text.get(begin..).ok_or_else(missing)?;
    let end = rest.find(END).ok_or_else(missing)?;
    Ok(begin..begin + end)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figures::Set;
    use Board::{Nano, Stm32};

    fn figures(compiler: &str, flash: f64) -> Figures {
        let mut figures = Figures::new(compiler, 16_000_000);
        let set = Set::from([("flash_bytes".to_owned(), flash)]);
        figures.images.insert("registers-16@38400".to_owned(), set);
        figures
    }

    #[test]
    fn the_table_is_replaced_when_its_figures_are_gone_and_the_rest_stays() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("figures.md");
        let (nano, stm32) = (Nano.begin(), Stm32.begin());
        let text = format!("before\n{nano}\n{END}\nbetween\n{stm32}\n{END}\nafter\n");
        fs::write(&path, text).expect("written");
        let (one, other, new) = (
            figures("one", 7001.0),
            figures("other", 7002.0),
            figures("one", 7003.0),
        );
        assert!(!check(&path, Nano, std::slice::from_ref(&one)).expect("read"));
        let shows = |flash: &str| fs::read_to_string(&path).expect("read").contains(flash);

        update(&path, Nano, std::slice::from_ref(&one), &one).expect("written");
        assert!(shows("| 7001 |") && check(&path, Nano, std::slice::from_ref(&one)).expect("read"));
        let both = [one, other.clone()];
        update(&path, Nano, &both, &other).expect("written");
        assert!(shows("| 7001 |") && check(&path, Nano, &both).expect("read"));
        let new = [new];
        assert!(!check(&path, Nano, &new).expect("read"));
        update(&path, Nano, &new, &new[0]).expect("written");
        assert!(shows("| 7003 |") && check(&path, Nano, &new).expect("read"));
        let text = fs::read_to_string(&path).expect("read");
        assert!(text.starts_with("before\n<!--") && text.ends_with("-->\nafter\n"));
        let other = format!("{END}\nbetween\n{stm32}\n{END}\nafter\n");
        assert!(text.ends_with(&other), "{text}");
        assert_eq!(&text[place(&path, Stm32, &text).expect("there")], "");
    }

    #[test]
    fn a_guide_without_the_place_is_an_error() {
        let path = Path::new("figures.md");
        for board in [Nano, Stm32] {
            let begin = board.begin();
            for text in [format!("{END}\n{begin}\n"), begin.to_owned(), String::new()] {
                assert!(place(path, board, &text).is_err(), "{text}");
            }
        }
    }
}
