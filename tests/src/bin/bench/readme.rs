//! The part of the figures that the README shows: written with the kept file, and checked against it, so that
//! it never tells of a firmware that is gone.

use std::fs;
use std::ops::Range;
use std::path::Path;

use crate::figures::Figures;
use crate::{Trouble, table};

/// The line before the table.
pub const BEGIN: &str = "<!-- written by: cargo xtask bench --record -->";
/// The line after it.
pub const END: &str = "<!-- end of what bench wrote -->";

/// Puts these figures there, unless those of another compiler that are still kept stand there.
pub fn update(path: &Path, kept: &[Figures], figures: &Figures) -> Result<(), Trouble> {
    let mut text = read(path)?;
    let place = place(path, &text)?;
    let own_or_gone = shown(&text[place.clone()], kept).is_none();
    if own_or_gone {
        text.replace_range(place, &section(figures));
        fs::write(path, text).map_err(|source| file(path, source))?;
        println!("shown in {}", path.display());
    }
    Ok(())
}

/// Whether what stands there is what is kept of some compiler; says so.
pub fn check(path: &Path, kept: &[Figures]) -> Result<bool, Trouble> {
    let text = read(path)?;
    let good = shown(&text[place(path, &text)?], kept).is_some();
    let verdict = if good { "ok     " } else { "CHANGED" };
    println!("  {verdict}  table in {}", path.display());
    if !good {
        println!("           it shows other figures than are kept: cargo xtask bench --record");
    }
    Ok(good)
}

/// Whose figures these are.
fn shown<'a>(text: &str, kept: &'a [Figures]) -> Option<&'a Figures> {
    kept.iter().find(|figures| section(figures) == text)
}

fn section(figures: &Figures) -> String {
    format!("\n{}\n", table::brief(figures))
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
fn place(path: &Path, text: &str) -> Result<Range<usize>, Trouble> {
    let missing = || Trouble::NoPlace(path.to_owned());
    let begin = text.find(BEGIN).ok_or_else(missing)? + BEGIN.len() + 1;
    let end = text.find(END).filter(|end| *end >= begin);
    Ok(begin..end.ok_or_else(missing)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figures::Set;

    fn figures(compiler: &str, flash: f64) -> Figures {
        let mut figures = Figures::new(compiler);
        let set = Set::from([("flash_bytes".to_owned(), flash)]);
        figures.images.insert("registers-16@38400".to_owned(), set);
        figures
    }

    #[test]
    fn the_table_is_replaced_when_its_figures_are_gone_and_the_rest_stays() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("README.md");
        fs::write(&path, format!("before\n{BEGIN}\n{END}\nafter\n")).expect("written");
        let (one, other, new) = (
            figures("one", 7001.0),
            figures("other", 7002.0),
            figures("one", 7003.0),
        );
        assert!(!check(&path, std::slice::from_ref(&one)).expect("read"));
        let shows = |flash: &str| fs::read_to_string(&path).expect("read").contains(flash);

        update(&path, std::slice::from_ref(&one), &one).expect("written");
        assert!(shows("| 7001 |") && check(&path, std::slice::from_ref(&one)).expect("read"));
        let both = [one, other.clone()];
        update(&path, &both, &other).expect("written");
        assert!(shows("| 7001 |") && check(&path, &both).expect("read"));
        let new = [new];
        assert!(!check(&path, &new).expect("read"));
        update(&path, &new, &new[0]).expect("written");
        assert!(shows("| 7003 |") && check(&path, &new).expect("read"));
        let text = fs::read_to_string(&path).expect("read");
        assert!(text.starts_with("before\n<!--") && text.ends_with("-->\nafter\n"));
    }

    #[test]
    fn a_readme_without_the_place_is_an_error() {
        assert!(place(Path::new("README.md"), &format!("{END}\n{BEGIN}\n")).is_err());
        assert!(place(Path::new("README.md"), "").is_err());
    }
}
