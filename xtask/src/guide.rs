//! Checks of README, guide and the other texts of the repository: links lead to files, Rust code is from files that
//! are compiled, and the guide names all its chapters.

use crate::error::Error;
use crate::repo;
use crate::tally::Tally;
use pulldown_cmark::{CodeBlockKind, Event, Options, Parser, Tag, TagEnd};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::process::Command;

/// The texts beside the guide.
const TEXTS: [&str; 3] = ["README.md", "CHANGELOG.md", "CONTRIBUTING.md"];
/// Folders of the packages for the registry. Their READMEs are read without the repository.
const PACKAGES: [&str; 3] = ["protocol", "firmware", "board-nano/embassy-avr-hal"];
/// How the sources of a package name its README, whose code rustdoc then compiles.
const DOC_TEST: &str = "include_str!(\"../README.md\")";
/// The chapters of the guide.
const CHAPTERS: &str = "docs/src";
/// The table of contents, in [`CHAPTERS`].
const SUMMARY: &str = "SUMMARY.md";
/// Lines that the README may have.
const README_LINES: usize = 120;

/// The packages whose API documentation must build without a warning.
pub const DOCUMENTED: [&str; 5] = [
    "multidrop-protocol",
    "multidrop",
    "multidrop-apps",
    "multidrop-bus",
    "xtask",
];

/// Checks all texts below `root`; returns one line for each fault.
///
/// # Errors
/// [`Error::failed`] when a text cannot be read.
pub fn check(root: &Path) -> Result<Vec<String>, Error> {
    let read = |path: &Path| {
        fs::read_to_string(root.join(path))
            .map_err(|error| Error::failed(format!("{}: {error}", path.display())))
    };
    let mut chapters = Vec::new();
    collect(root, Path::new(CHAPTERS), "md", &mut chapters)?;
    chapters.sort();
    let mut texts = BTreeMap::new();
    let readmes = PACKAGES.map(|folder| Path::new(folder).join(TEXTS[0]));
    let beside = TEXTS.iter().map(PathBuf::from).chain(readmes);
    for path in beside.chain(chapters.clone()) {
        let text = read(&path)?;
        texts.insert(path, text);
    }
    let mut faults = Vec::new();
    for (path, text) in &texts {
        let is_chapter = path.starts_with(CHAPTERS);
        let package = PACKAGES.into_iter().find(|folder| path.starts_with(folder));
        let is_doc_test = package.is_some_and(|folder| {
            let sources = fs::read_to_string(root.join(folder).join("src/lib.rs"));
            sources.is_ok_and(|text| text.contains(DOC_TEST))
        });
        let parsed = Parsed::of(text);
        let mut wrong = |line, what: String| {
            faults.push(format!("{}:{line}: {what}", path.display()));
        };
        for (line, link) in &parsed.links {
            if let Err(what) = check_link(root, path, link, package) {
                wrong(*line, format!("{link}: {what}"));
            }
        }
        for (line, named) in &parsed.paths {
            if !root.join(named).exists() {
                wrong(*line, format!("{named}: there is no such file or folder"));
            }
        }
        for block in parsed.rust.iter().filter(|_| !is_doc_test) {
            if let Err(what) = check_block(root, path, block, is_chapter) {
                wrong(block.line, what);
            }
        }
    }
    for path in sources(root)? {
        for line in ignored(&read(&path)?) {
            let what = "code in doc comments must be compiled: `ignore` is not allowed";
            faults.push(format!("{}:{line}: {what}", path.display()));
        }
    }
    let readme = texts[Path::new(TEXTS[0])].lines().count();
    if readme > README_LINES {
        let what = format!("{readme} lines, must be {README_LINES} or fewer");
        faults.push(format!("{}: {what}", TEXTS[0]));
    }
    let summary = Path::new(CHAPTERS).join(SUMMARY);
    let Some(contents) = texts.get(&summary) else {
        faults.push(format!("{}: it is missing", summary.display()));
        return Ok(faults);
    };
    let named = Parsed::of(contents).links;
    for chapter in chapters.iter().filter(|chapter| **chapter != summary) {
        let is_named = named
            .iter()
            .any(|(_, link)| joined(&summary, link).as_deref() == Some(chapter));
        if !is_named {
            let what = format!("the chapter {} is not named", chapter.display());
            faults.push(format!("{}: {what}", summary.display()));
        }
    }
    Ok(faults)
}

/// Checks the texts, builds the guide if mdbook is there, and the API documentation.
pub fn run(tally: &mut Tally) {
    tally.faults("links and code of README and guide", check(repo::root()));

    let name = "build of the guide";
    let of_ours = repo::root().join("target/tools/bin/mdbook");
    let mdbook = repo::in_path("mdbook").or_else(|| of_ours.is_file().then_some(of_ours));
    match mdbook {
        Some(mdbook) => {
            let mut build = Command::new(mdbook);
            build.current_dir(repo::root()).args(["build", "docs"]);
            run_counted(tally, name, &mut build);
        }
        None => tally.skip(name, "mdbook is not installed: cargo install mdbook"),
    }

    let mut doc = repo::cargo_in_root(&["doc", "--no-deps"]);
    doc.env("RUSTDOCFLAGS", "-D warnings");
    for package in DOCUMENTED {
        doc.args(["--package", package]);
    }
    run_counted(tally, "API documentation without warnings", &mut doc);
}

fn run_counted(tally: &mut Tally, name: &str, command: &mut Command) {
    let outcome = repo::run(command);
    if let Err(error) = &outcome {
        println!("{}", error.message());
    }
    tally.check(name, outcome.is_ok());
}

/// All Rust files below `root`, from there, in the order of their paths.
///
/// # Errors
/// [`Error::failed`] when a folder cannot be read.
pub fn sources(root: &Path) -> Result<Vec<PathBuf>, Error> {
    let mut sources = Vec::new();
    collect(root, Path::new(""), "rs", &mut sources)?;
    sources.sort();
    Ok(sources)
}

/// The files with this extension below `folder`, from `root`; without build results and hidden files.
/// The files with this extension below a folder, build results and hidden files aside.
pub fn collect(
    root: &Path,
    folder: &Path,
    extension: &str,
    found: &mut Vec<PathBuf>,
) -> Result<(), Error> {
    let failed = |error| Error::failed(format!("{}: {error}", folder.display()));
    for entry in fs::read_dir(root.join(folder)).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let name = entry.file_name();
        let path = folder.join(&name);
        if name == "target" || name.to_string_lossy().starts_with('.') {
            continue;
        }
        if entry.path().is_dir() {
            collect(root, &path, extension, found)?;
        } else if path.extension().is_some_and(|found| found == extension) {
            found.push(path);
        }
    }
    Ok(())
}

/// The lines of doc comments that begin code which rustdoc does not compile.
fn ignored(source: &str) -> impl Iterator<Item = usize> {
    let is_ignored = |line: &str| {
        let comment = line.trim_start().strip_prefix("//");
        let fence = comment.and_then(|text| {
            text.trim_start_matches(['/', '!'])
                .trim()
                .strip_prefix("```")
        });
        fence.is_some_and(|info| info.split(',').any(|word| word.trim() == "ignore"))
    };
    let lines = source.lines().enumerate();
    lines.filter_map(move |(index, line)| is_ignored(line).then_some(index + 1))
}

/// A block of Rust code.
struct Block {
    line: usize,
    code: String,
    /// The source that a comment before the block names: `<!-- from: PATH:ANCHOR -->`.
    from: Option<String>,
}

/// The parts of a text that are checked, each with its line.
#[derive(Default)]
struct Parsed {
    links: Vec<(usize, String)>,
    /// Files and folders of the repository in inline code.
    paths: Vec<(usize, String)>,
    rust: Vec<Block>,
    headings: Vec<String>,
}

impl Parsed {
    fn of(text: &str) -> Parsed {
        let mut parsed = Parsed::default();
        let mut heading: Option<String> = None;
        let mut block: Option<Block> = None;
        let mut from = None;
        let options = Options::ENABLE_TABLES | Options::ENABLE_FOOTNOTES;
        for (event, place) in Parser::new_ext(text, options).into_offset_iter() {
            let line = text[..place.start].matches('\n').count() + 1;
            match event {
                Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                    parsed.links.push((line, dest_url.into_string()));
                }
                Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
                Event::End(TagEnd::Heading(_)) => {
                    let slug = slug(&heading.take().unwrap_or_default());
                    parsed.headings.push(slug);
                }
                Event::Start(Tag::CodeBlock(CodeBlockKind::Fenced(info))) if is_rust(&info) => {
                    let code = String::new();
                    let from = from.take();
                    block = Some(Block { line, code, from });
                }
                Event::End(TagEnd::CodeBlock) => parsed.rust.extend(block.take()),
                Event::Html(html) => from = source_of(&html),
                Event::Text(text) | Event::Code(text) if heading.is_some() => {
                    heading.get_or_insert_default().push_str(&text);
                }
                Event::Text(text) => {
                    if let Some(block) = &mut block {
                        block.code.push_str(&text);
                    }
                }
                Event::Code(code) if is_path(&code) => {
                    parsed.paths.push((line, code.into_string()));
                }
                _ => {}
            }
        }
        parsed
    }

    /// The anchors of the headings; a repeated one has a number appended.
    fn anchors(&self) -> Vec<String> {
        let mut seen: BTreeMap<&str, usize> = BTreeMap::new();
        let mut anchors = Vec::new();
        for slug in &self.headings {
            let count = seen.entry(slug).or_default();
            anchors.push(match *count {
                0 => slug.clone(),
                count => format!("{slug}-{count}"),
            });
            *count += 1;
        }
        anchors
    }
}

fn is_rust(info: &str) -> bool {
    let language = info.split([',', ' ']).next();
    matches!(language, Some("rust" | "rs"))
}

/// `PATH:ANCHOR` of `<!-- from: PATH:ANCHOR -->`.
fn source_of(html: &str) -> Option<String> {
    let inside = html.trim().strip_prefix("<!-- from: ")?;
    Some(inside.strip_suffix(" -->")?.to_owned())
}

/// Whether inline code names a file or folder of the repository. Build results are in `target`.
fn is_path(code: &str) -> bool {
    const FOLDERS: [&str; 11] = [
        "protocol/",
        "firmware/",
        "apps/",
        "board-nano/",
        "board-stm32/",
        "sim/",
        "tests/",
        "xtask/",
        "docs/",
        "fuzz/",
        "host-bench/",
    ];
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/_-.".contains(c);
    FOLDERS.iter().any(|folder| code.starts_with(folder)) && code.chars().all(is_plain)
}

/// The anchor of a heading in mdBook and on GitHub.
fn slug(heading: &str) -> String {
    let kept = heading.trim().chars().filter_map(|c| match c {
        ' ' => Some('-'),
        '-' | '_' => Some(c),
        c if c.is_alphanumeric() => Some(c.to_ascii_lowercase()),
        _ => None,
    });
    kept.collect()
}

/// The target of a link in the text `from`, from the root of the repository; `None` if it is outside.
fn joined(from: &Path, link: &str) -> Option<PathBuf> {
    let target = link.split('#').next().unwrap_or_default();
    if target.is_empty() {
        return Some(from.to_owned());
    }
    let mut path = from.parent()?.to_owned();
    for part in Path::new(target).components() {
        match part {
            Component::Normal(name) => path.push(name),
            Component::CurDir => {}
            Component::ParentDir if path.pop() => {}
            _ => return None,
        }
    }
    Some(path)
}

fn check_link(root: &Path, from: &Path, link: &str, package: Option<&str>) -> Result<(), String> {
    if link.contains("://") || link.starts_with("mailto:") {
        return Ok(());
    }
    let target = joined(from, link).ok_or("the target is outside of the repository")?;
    if from.starts_with(CHAPTERS) && !target.starts_with(CHAPTERS) {
        return Err(
            "the target is outside of the guide, which is read without the repository".to_owned(),
        );
    }
    if package.is_some_and(|folder| !target.starts_with(folder)) {
        return Err(
            "the target is outside of the package, which is read without the repository".to_owned(),
        );
    }
    if !root.join(&target).exists() {
        return Err("there is no such file".to_owned());
    }
    let Some((_, anchor)) = link.split_once('#') else {
        return Ok(());
    };
    let text = fs::read_to_string(root.join(&target)).map_err(|error| error.to_string())?;
    match Parsed::of(&text)
        .anchors()
        .iter()
        .any(|known| known == anchor)
    {
        true => Ok(()),
        false => Err(format!("{} has no such heading", target.display())),
    }
}

fn check_block(root: &Path, from: &Path, block: &Block, is_chapter: bool) -> Result<(), String> {
    if is_chapter {
        let included = included(&block.code).ok_or(
            "Rust code in the guide must be one {{#include PATH:ANCHOR}} of a compiled file",
        )?;
        return anchored(root, from, included).map(drop);
    }
    let source = block
        .from
        .as_deref()
        .ok_or("Rust code must have <!-- from: PATH:ANCHOR --> in the line before it")?;
    let source = anchored(root, from, source)?;
    let lines = |text: &str| text.lines().map(str::to_owned).collect::<Vec<_>>();
    let (shown, right) = (lines(&block.code), lines(&source));
    let same = shown.iter().zip(&right).take_while(|(a, b)| a == b).count();
    if same == shown.len() && same == right.len() {
        return Ok(());
    }
    let line = |lines: &[String]| lines.get(same).map_or("nothing", |line| line).to_owned();
    let (shown, right) = (line(&shown), line(&right));
    Err(format!(
        "line {} of the code is `{shown}`, in its source `{right}`",
        same + 1
    ))
}

/// `PATH:ANCHOR` of code that is one include and nothing else.
fn included(code: &str) -> Option<&str> {
    let inside = code.trim().strip_prefix("{{#include ")?;
    inside.strip_suffix("}}")
}

/// The lines of `PATH:ANCHOR` between `// ANCHOR: NAME` and `// ANCHOR_END: NAME`, without those of other anchors.
fn anchored(root: &Path, from: &Path, source: &str) -> Result<String, String> {
    let (path, name) = source
        .split_once(':')
        .ok_or_else(|| format!("{source}: the path has no anchor"))?;
    let file = joined(from, path).ok_or_else(|| format!("{path} is outside of the repository"))?;
    if file.extension().is_none_or(|extension| extension != "rs") || file.starts_with("docs") {
        return Err(format!("{path} is not a compiled Rust file"));
    }
    let text = fs::read_to_string(root.join(&file)).map_err(|error| format!("{path}: {error}"))?;
    let (begin, end) = (
        format!("// ANCHOR: {name}"),
        format!("// ANCHOR_END: {name}"),
    );
    let mut inside = text.lines().skip_while(|line| line.trim() != begin);
    let mut found = String::new();
    let missing = || format!("{path} has no lines `{begin}` and `{end}`");
    inside.next().ok_or_else(missing)?;
    for line in inside {
        match line.trim() {
            line if line == end => return Ok(found),
            line if line.starts_with("// ANCHOR") => {}
            _ => {
                found.push_str(line);
                found.push('\n');
            }
        }
    }
    Err(missing())
}

#[cfg(test)]
mod tests;
