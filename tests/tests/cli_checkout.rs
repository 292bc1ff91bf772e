//! The checkout that the commands work on: the one they are called in, wherever they were built. A checkout that is
//! copied with its target folder has programs that were built in another one.

use multidrop_testkit::places;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

/// Copies the sources of `from`.
fn copy_sources(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder");
    for entry in fs::read_dir(from).expect("a folder of the repository") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().expect("a name");
        if name == "target" || name == ".git" {
            continue;
        }
        if path.is_dir() {
            copy_sources(&path, &to.join(name));
        } else if path.is_file() {
            fs::copy(&path, to.join(name)).expect("a copy");
        }
    }
}

/// Another checkout, whose Nano cannot be built.
fn broken_checkout() -> (TempDir, PathBuf) {
    let folder = TempDir::new_in(places::scratch()).expect("a folder for the test");
    let root = folder.path().join("copy");
    copy_sources(&places::root(), &root);
    fs::write(root.join("board-nano/Cargo.toml"), "broken on purpose").expect("written");
    (folder, root)
}

fn build(xtask: &Path, current: &Path, package: Option<&Path>) -> Output {
    let mut command = Command::new(xtask);
    command
        .current_dir(current)
        .env_remove("CARGO_MANIFEST_DIR")
        .args(["build", "nano", "registers"]);
    if let Some(package) = package {
        command.env("CARGO_MANIFEST_DIR", package);
    }
    command.output().expect("it runs")
}

/// The broken manifest is of the copy; that of the original would have done.
fn assert_built_the_copy(output: &Output) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert!(said.contains("copy/target/avr "), "{said}");
}

#[test]
fn the_commands_work_on_the_checkout_they_are_called_in() {
    let xtask = places::xtask();
    let (_folder, root) = broken_checkout();
    let here = places::root();
    for current in [root.clone(), root.join("protocol/src")] {
        assert_built_the_copy(&build(&xtask, &current, None));
        // What called the command may have been run by the cargo of another checkout.
        assert_built_the_copy(&build(&xtask, &current, Some(&here)));
    }
    // `cargo run --manifest-path`, called elsewhere.
    let elsewhere = tempfile::tempdir().expect("a folder outside of the repository");
    let package = root.join("xtask");
    assert_built_the_copy(&build(&xtask, elsewhere.path(), Some(&package)));
}

#[test]
fn outside_of_a_checkout_the_commands_are_refused() {
    let elsewhere = tempfile::tempdir().expect("a folder outside of the repository");
    let output = build(&places::xtask(), elsewhere.path(), None);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(said.contains("is not in a checkout of multidrop"), "{said}");
}

#[test]
fn the_simulator_takes_the_barrier_of_the_checkout_it_is_called_in() {
    let (_folder, root) = broken_checkout();
    let output = Command::new(places::program("sim"))
        .current_dir(&root)
        .env_remove("CARGO_MANIFEST_DIR")
        .args(["stm32-conformance", "--qemu", "--image", "no.elf"])
        .output()
        .expect("it runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(said.contains("barrier.so is missing"), "{said}");
}

/// Every source of the host's crates below `folder`.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder of the repository") {
        let path = entry.expect("an entry").path();
        if path.is_dir() && path.file_name().is_some_and(|name| name != "target") {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn no_source_uses_the_folder_in_which_it_was_compiled() {
    let root = places::root();
    let mut found = Vec::new();
    for package in [
        "protocol",
        "firmware",
        "apps",
        "sim",
        "tests",
        "xtask",
        "host-bench",
        "fuzz",
    ] {
        sources(&root.join(package), &mut found);
    }
    assert!(found.len() > 100, "where are the sources?");
    for path in found {
        let text = fs::read_to_string(&path).expect("a source");
        for name in ["MANIFEST_DIR", "TARGET_TMPDIR", "BIN_EXE"] {
            let taken = text.contains(&format!("env!(\"CARGO_{name}"));
            assert!(
                !taken,
                "{} takes CARGO_{name} when it is compiled",
                path.display()
            );
        }
    }
}
