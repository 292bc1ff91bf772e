//! Each check on made-up texts: sound ones, and one fault at a time.

use super::*;

/// A repository that all checks find good.
struct Repository(tempfile::TempDir);

impl Repository {
    fn new() -> Repository {
        let repository = Repository(tempfile::tempdir().expect("a folder"));
        let write = |path, text| repository.write(path, text);
        write(
            "node/main.rs",
            "use a;\n// ANCHOR: node\nfn node() {\n    // ANCHOR: inner\n    go();\n    // ANCHOR_END: inner\n}\n// ANCHOR_END: node\n",
        );
        write(
            "README.md",
            "# A\n\n[guide](docs/src/one.md#two-words)\n\n<!-- from: node/main.rs:node -->\n```rust\nfn node() {\n    go();\n}\n```\n",
        );
        write("CHANGELOG.md", "# Changelog\n\n[A](#changelog)\n");
        write("CONTRIBUTING.md", "[out](https://example.com/#x)\n");
        write(
            "docs/src/SUMMARY.md",
            "- [One](one.md)\n- [Two](deep/two.md)\n",
        );
        write(
            "docs/src/one.md",
            "## Two `words`!\n\n| a |\n|---|\n| [two](deep/two.md) |\n\n```rust,no_run\n{{#include ../../node/main.rs:node}}\n```\n",
        );
        write(
            "docs/src/deep/two.md",
            "# Same\n\n# Same\n\n[b](../one.md), [c](#same-1)\n\n```\n$ sh\n```\n",
        );
        write("protocol/README.md", "```rust\nfn tested() {}\n```\n");
        write(
            "protocol/src/lib.rs",
            "#[doc = include_str!(\"../README.md\")]\n",
        );
        write("firmware/README.md", "[licence](LICENSE)\n");
        write("firmware/LICENSE", "text\n");
        write(
            "board-nano/embassy-avr-hal/README.md",
            "<!-- from: ../../node/main.rs:inner -->\n```rust\n    go();\n```\n",
        );
        repository
    }

    fn write(&self, path: &str, text: &str) {
        let path = self.0.path().join(path);
        fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        fs::write(path, text).expect("written");
    }

    /// With `new` in place of `old` in one file.
    fn faults(path: &str, old: &str, new: &str) -> Vec<String> {
        let repository = Repository::new();
        let text = fs::read_to_string(repository.0.path().join(path)).expect("read");
        assert!(text.contains(old), "{path}: {old}");
        repository.write(path, &text.replace(old, new));
        check(repository.0.path()).expect("read")
    }
}

/// The one fault has `said` in it.
fn assert_fault(path: &str, old: &str, new: &str, said: &str) {
    let faults = Repository::faults(path, old, new);
    assert!(
        faults.len() == 1 && faults[0].contains(said),
        "{path}: {new}: {faults:?} instead of {said}"
    );
}

#[test]
fn sound_texts_have_no_fault() {
    assert_eq!(check(Repository::new().0.path()).expect("read"), [""; 0]);
}

#[test]
fn a_link_that_leads_nowhere_is_a_fault() {
    let one = "docs/src/one.md";
    assert_fault(
        one,
        "(deep/two.md)",
        "(deep/too.md)",
        "one.md:5: deep/too.md: there is no such file",
    );
    assert_fault("README.md", "#two-words", "#two", "has no such heading");
    assert_fault(
        "README.md",
        "docs/src/one.md",
        "../one.md",
        "the target is outside of the repository",
    );
    assert_fault(
        "CHANGELOG.md",
        "[A](#changelog)",
        "![A](bus.png)",
        "there is no such file",
    );
    assert_fault(
        "docs/src/deep/two.md",
        "#same-1",
        "#same-2",
        "has no such heading",
    );
    assert_fault(
        "docs/src/deep/two.md",
        "../one.md",
        "../../../README.md",
        "the target is outside of the guide",
    );
}

#[test]
fn a_readme_of_a_package_stands_without_the_repository_and_its_code_is_compiled() {
    assert_fault(
        "firmware/README.md",
        "LICENSE",
        "../README.md",
        "the target is outside of the package",
    );
    assert_fault(
        "protocol/src/lib.rs",
        "README",
        "CHANGELOG",
        "Rust code must have <!-- from: PATH:ANCHOR -->",
    );
    assert_fault(
        "board-nano/embassy-avr-hal/README.md",
        "go()",
        "come()",
        "in its source `    go();`",
    );
}

#[test]
fn a_file_that_is_named_and_not_there_is_a_fault() {
    let named = "`tests/gone.rs`";
    assert_fault(
        "CONTRIBUTING.md",
        "[out]",
        named,
        "tests/gone.rs: there is no such file",
    );
    assert_eq!(
        Repository::faults("CONTRIBUTING.md", "[out]", "`tests/*.rs` `a/b`"),
        [""; 0]
    );
}

#[test]
fn rust_code_that_nobody_compiles_is_a_fault() {
    let (one, include) = ("docs/src/one.md", "{{#include ../../node/main.rs:node}}");
    assert_fault(
        one,
        include,
        "fn node() {}",
        "must be one {{#include PATH:ANCHOR}}",
    );
    assert_fault(
        one,
        include,
        &format!("{include}\nlet a = 1;"),
        "must be one {{#include PATH:ANCHOR}}",
    );
    assert_fault(one, ":node}}", ":knot}}", "has no lines `// ANCHOR: knot`");
    assert_fault(one, "main.rs:node", "main.rs", "the path has no anchor");
    assert_fault(
        one,
        "../../node/main.rs",
        "../../CHANGELOG.md",
        "is not a compiled Rust file",
    );
    assert_fault(
        one,
        "../../node/main.rs",
        "../../node/gone.rs",
        "No such file",
    );
    assert_fault(
        one,
        "../../node/main.rs",
        "deep/main.rs",
        "is not a compiled Rust file",
    );
    assert_fault(one, "node}}", "node}}{{#include a.rs:b}}", "has no lines");
    let no_end = Repository::faults("node/main.rs", "// ANCHOR_END: node\n", "");
    assert_eq!(no_end.len(), 2, "of README and of guide: {no_end:?}");
}

#[test]
fn code_in_comments_that_rustdoc_does_not_compile_is_a_fault() {
    let said = "node/main.rs:1: code in doc comments must be compiled";
    for fence in ["//! ```ignore", "/// ```rust, ignore", "    //! ```ignore"] {
        assert_fault("node/main.rs", "use a;", fence, said);
    }
    for fence in ["//! ```no_run", "let a = \"```ignore\";", "// ignore"] {
        assert_eq!(Repository::faults("node/main.rs", "use a;", fence), [""; 0]);
    }
}

#[test]
fn code_of_the_readme_that_is_not_that_of_its_source_is_a_fault() {
    assert_fault(
        "README.md",
        "    go();",
        "    went();",
        "line 2 of the code is `    went();`, in its source `    go();`",
    );
    assert_fault(
        "README.md",
        "}\n",
        "}\nmore\n",
        "line 4 of the code is `more`, in its source `nothing`",
    );
    assert_fault(
        "README.md",
        "}\n",
        "",
        "line 3 of the code is `nothing`, in its source `}`",
    );
    assert_fault(
        "README.md",
        "<!-- from: node/main.rs:node -->\n",
        "",
        "<!-- from: PATH:ANCHOR -->",
    );
    assert_fault(
        "CONTRIBUTING.md",
        "[out]",
        "\n```rust\nfn a() {}\n```\n",
        "<!-- from: PATH:ANCHOR -->",
    );
}

#[test]
fn a_readme_that_grows_is_a_fault() {
    let with = |lines: usize| format!("# A\n{}", "\n".repeat(lines - 10));
    let full = Repository::faults("README.md", "# A\n", &with(README_LINES));
    assert_eq!(full, [""; 0]);
    let more = with(README_LINES + 1);
    assert_fault(
        "README.md",
        "# A\n",
        &more,
        "121 lines, must be 120 or fewer",
    );
}

#[test]
fn a_chapter_that_the_contents_do_not_name_is_a_fault() {
    assert_fault(
        "docs/src/SUMMARY.md",
        "- [Two](deep/two.md)\n",
        "",
        "docs/src/deep/two.md is not named",
    );
    let repository = Repository::new();
    fs::remove_file(repository.0.path().join("docs/src/SUMMARY.md")).expect("removed");
    let faults = check(repository.0.path()).expect("read");
    assert_eq!(faults, ["docs/src/SUMMARY.md: it is missing"]);
}

#[test]
fn the_texts_of_this_repository_are_sound() {
    assert_eq!(check(repo::root()).expect("read"), [""; 0]);
}

#[test]
fn the_guide_shows_what_is_kept_of_the_server_on_the_host() {
    let read = |path| fs::read_to_string(repo::root().join(path)).expect("read");
    let kept: serde_json::Value = serde_json::from_str(&read("figures/host.json")).expect("JSON");
    let text = read("docs/src/figures.md");
    let shows = |of_a_compiler: &serde_json::Value| {
        ["03x16", "10x16"].iter().all(|request| {
            let figure = |who| &of_a_compiler["figures"][format!("{who}_{request}_instructions")];
            let row = format!("| {request} | {} | {} |", figure("ours"), figure("rmodbus"));
            text.lines().any(|line| line == row)
        })
    };
    let compilers = kept.as_array().expect("one entry for each compiler");
    assert!(compilers.iter().any(shows), "docs/src/figures.md: {kept}");
}
