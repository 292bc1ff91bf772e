//! The figures kept in the repository: written on purpose, compared for equality.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use serde::Serialize;

use crate::Trouble;
use crate::figures::{Figures, Set};

/// Writes the figures of this run as JSON; under a name, into the file that is there.
pub fn write(path: &Path, name: Option<&str>, figures: &Figures) -> Result<(), Trouble> {
    let Some(name) = name else {
        return save(path, figures);
    };
    let text = fs::read_to_string(path).map_err(|source| file(path, source))?;
    let json = |source| Trouble::Json {
        path: path.to_owned(),
        source,
    };
    let mut all: serde_json::Value = serde_json::from_str(&text).map_err(json)?;
    all[name] = serde_json::to_value(figures).map_err(json)?;
    save(path, &all)
}

fn save(path: &Path, contents: &impl Serialize) -> Result<(), Trouble> {
    let json = |source| Trouble::Json {
        path: path.to_owned(),
        source,
    };
    let mut text = serde_json::to_string_pretty(contents).map_err(json)?;
    text.push('\n');
    fs::write(path, text).map_err(|source| file(path, source))
}

fn file(path: &Path, source: std::io::Error) -> Trouble {
    Trouble::File {
        path: path.to_owned(),
        source,
    }
}

/// What is kept: the figures by compiler, because another code generator or C library makes other code of
/// the same sources.
pub fn load(path: &Path) -> Result<Vec<Figures>, Trouble> {
    let text = fs::read_to_string(path).map_err(|source| file(path, source))?;
    serde_json::from_str(&text).map_err(|source| Trouble::Json {
        path: path.to_owned(),
        source,
    })
}

/// Keeps these figures in place of those of the same compiler. If they have changed, those of other compilers
/// are of a firmware that is gone, and go too. Gives all that are kept now.
pub fn record(path: &Path, figures: &Figures) -> Result<Vec<Figures>, Trouble> {
    let kept = if path.exists() {
        load(path)?
    } else {
        Vec::new()
    };
    let (own, mut others): (Vec<_>, Vec<_>) = kept
        .into_iter()
        .partition(|kept| kept.compiler == figures.compiler);
    println!("\nrecorded in {}", path.display());
    if own.first().is_some_and(|own| own != figures) {
        for other in others.drain(..) {
            println!(
                "dropped, because the firmware is another now: {}",
                other.compiler
            );
        }
    }
    others.push(figures.clone());
    others.sort_by(|a, b| a.compiler.cmp(&b.compiler));
    save(path, &others)?;
    Ok(others)
}

/// Takes over what is kept of `image` for the compiler of `figures`, if it has any kept: what takes too long to be
/// measured each time.
pub fn take_over(path: &Path, image: &str, figures: &mut Figures) -> Result<(), Trouble> {
    let kept = load(path)?.into_iter();
    let own = kept.filter(|kept| kept.compiler == figures.compiler);
    for mut kept in own {
        let set = kept.images.remove(image).unwrap_or_default();
        figures.images.insert(image.to_owned(), set);
    }
    Ok(())
}

/// Compares with what is kept, prints the differences, and gives whether each image is as it was: nothing
/// where no figures of this compiler are kept. Flash may be off by `padding` bytes.
pub fn compare(path: &Path, measured: &Figures, padding: f64) -> Result<Vec<bool>, Trouble> {
    println!("\nFigures kept in {}", path.display());
    let all = load(path)?;
    let Some(kept) = all.iter().find(|kept| kept.compiler == measured.compiler) else {
        println!(
            "  NOT COMPARED: these images are of {}, but kept are those of",
            measured.compiler
        );
        for kept in &all {
            println!("  {}", kept.compiler);
        }
        println!(
            "  Only the goals above are checked. To keep these too: cargo xtask bench --record"
        );
        return Ok(Vec::new());
    };
    let none = Set::new();
    let names = kept.images.keys().chain(measured.images.keys());
    let mut verdicts = Vec::new();
    for image in names.collect::<BTreeSet<_>>() {
        let was = kept.images.get(image).unwrap_or(&none);
        let is = measured.images.get(image).unwrap_or(&none);
        let lines = differences(was, is, padding);
        let verdict = if lines.is_empty() {
            "ok     "
        } else {
            "CHANGED"
        };
        println!("  {verdict}  {image}");
        for line in &lines {
            println!("           {line}");
        }
        verdicts.push(lines.is_empty());
    }
    if verdicts.contains(&false) {
        println!("  If it is meant, record it: cargo xtask bench --record");
    }
    Ok(verdicts)
}

/// One line for each figure that is not what it was.
fn differences(kept: &Set, measured: &Set, padding: f64) -> Vec<String> {
    let names: BTreeSet<_> = kept.keys().chain(measured.keys()).collect();
    let shown = |value: Option<&f64>| value.map_or("nothing".to_owned(), f64::to_string);
    names
        .into_iter()
        .filter(|name| match (kept.get(*name), measured.get(*name)) {
            (Some(was), Some(is)) if *name == "flash_bytes" => (was - is).abs() > padding,
            (was, is) => was != is,
        })
        .map(|name| {
            let (was, is) = (shown(kept.get(name)), shown(measured.get(name)));
            format!("{name}: kept {was}, measured {is}")
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_difference_names_figure_kept_and_measured() {
        let kept = Set::from([
            ("same".to_owned(), 1.5),
            ("stack_peak_bytes".to_owned(), 100.0),
            ("gone".to_owned(), 3.0),
        ]);
        let measured = Set::from([
            ("same".to_owned(), 1.5),
            ("stack_peak_bytes".to_owned(), 101.0),
            ("new".to_owned(), 4.0),
        ]);
        assert_eq!(
            differences(&kept, &measured, 0.0),
            [
                "gone: kept 3, measured nothing",
                "new: kept nothing, measured 4",
                "stack_peak_bytes: kept 100, measured 101",
            ]
        );
        assert!(differences(&kept, &kept, 0.0).is_empty());
    }

    #[test]
    fn flash_alone_may_differ_by_padding() {
        let set = |name: &str, bytes| Set::from([(name.to_owned(), bytes)]);
        let count =
            |name, is, padding| differences(&set(name, 100.0), &set(name, is), padding).len();
        for (name, is, padding, differs) in [
            ("flash_bytes", 104.0, 4.0, 0),
            ("flash_bytes", 96.0, 4.0, 0),
            ("flash_bytes", 105.0, 4.0, 1),
            ("flash_bytes", 101.0, 0.0, 1),
            ("static_ram_bytes", 101.0, 4.0, 1),
        ] {
            assert_eq!(count(name, is, padding), differs, "{name} {is} {padding}");
        }
        assert_eq!(
            differences(&set("flash_bytes", 1.0), &Set::new(), 4.0).len(),
            1
        );
    }

    #[test]
    fn what_is_taken_over_is_of_the_same_compiler_and_missing_where_it_is_not_kept() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("figures.json");
        record(&path, &figures("one", 0.1)).expect("written");
        let taken = |compiler: &str, image: &str| {
            let mut figures = Figures::new(compiler, 1);
            take_over(&path, image, &mut figures).expect("read");
            figures.images.remove(image)
        };
        let kept = figures("one", 0.1).images.remove("registers-16@38400");
        assert_eq!(taken("one", "registers-16@38400"), kept);
        assert_eq!(taken("one", "another image"), Some(Set::new()));
        assert_eq!(taken("another", "registers-16@38400"), None);
    }

    fn figures(compiler: &str, value: f64) -> Figures {
        let mut figures = Figures::new(compiler, 16_000_000);
        let set = Set::from([("a_us".to_owned(), value), ("b_us".to_owned(), 1750.063)]);
        figures.images.insert("registers-16@38400".to_owned(), set);
        figures
    }

    #[test]
    fn recorded_figures_are_compared_to_the_last_digit() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("figures.json");
        record(&path, &figures("one", 0.1)).expect("written");
        let compared = |value| compare(&path, &figures("one", value), 0.0).expect("read");
        assert_eq!(compared(0.1), [true]);
        assert_eq!(compared(0.101), [false]);
        let other = compare(&path, &figures("another", 0.101), 0.0).expect("read");
        assert!(other.is_empty(), "another compiler's figures are its own");
    }

    #[test]
    fn figures_of_other_compilers_are_kept_as_long_as_the_firmware_is_the_same() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("figures.json");
        for (compiler, value, kept) in [
            ("one", 0.1, &["one"][..]),
            ("another", 0.2, &["another", "one"]),
            ("one", 0.1, &["another", "one"]),
            ("one", 0.3, &["one"]),
        ] {
            record(&path, &figures(compiler, value)).expect("written");
            let now = load(&path).expect("read");
            let names: Vec<_> = now.iter().map(|kept| kept.compiler.as_str()).collect();
            assert_eq!(names, kept);
        }
    }
}
