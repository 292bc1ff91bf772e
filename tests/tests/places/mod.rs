//! Where a test finds the repository's files, a folder to write to, and the programs. All is found when the test runs: in a
//! checkout that was copied with its target folder the tests are not compiled again.
#![allow(dead_code, reason = "each test binary uses a part")]

use std::path::{Path, PathBuf};

/// The root of the repository.
pub fn root() -> PathBuf {
    multidrop_bus::repository().expect("the test is run by cargo, in the repository")
}

/// The folder of this package.
pub fn package() -> PathBuf {
    root().join("tests")
}

/// A folder for what tests write.
pub fn scratch() -> PathBuf {
    let folder = target().join("tmp");
    std::fs::create_dir_all(&folder).expect("a folder for tests");
    folder
}

/// A program of this package, which cargo builds for its tests.
pub fn program(name: &str) -> PathBuf {
    built().join(name)
}

/// The command's program itself.
pub fn xtask() -> PathBuf {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let built = std::process::Command::new(cargo)
        .current_dir(root())
        .args(["build", "--quiet", "--package", "xtask"])
        .status();
    assert!(built.expect("cargo runs").success());
    target().join("debug/xtask")
}

/// Where cargo puts the programs of the profile that the test was built in.
fn built() -> PathBuf {
    let test = std::env::current_exe().expect("the test's own path");
    let folder = test.parent().and_then(Path::parent);
    folder.expect("tests are built in PROFILE/deps").to_owned()
}

fn target() -> PathBuf {
    let built = built();
    built.parent().expect("a target folder").to_owned()
}
