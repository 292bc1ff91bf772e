//! Where a test finds the repository's files, a folder to write to, and the programs. All is found when the test runs: in a
//! checkout that was copied with its target folder the tests are not compiled again.

use std::path::{Path, PathBuf};

/// The root of the repository.
pub fn root() -> PathBuf {
    multidrop_bus::repository().expect("the test is run by cargo, in the repository")
}

/// Where the assembler programs of the tests are, in `avr/` and `arm/`.
pub fn programs() -> PathBuf {
    root().join("tests/testkit")
}

/// A folder for what tests write.
pub fn scratch() -> PathBuf {
    let folder = target().join("tmp");
    std::fs::create_dir_all(&folder).expect("a folder for tests");
    folder
}

/// A program of the simulated bus, of the profile that the test was built in.
pub fn program(name: &str) -> PathBuf {
    build("multidrop-bus", built().ends_with("release"));
    built().join(name)
}

/// The command's program itself.
pub fn xtask() -> PathBuf {
    build("xtask", false);
    target().join("debug/xtask")
}

/// Has cargo build the programs of a package.
fn build(package: &str, is_release: bool) {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = std::process::Command::new(cargo);
    command.current_dir(root());
    command.args(["build", "--quiet", "--package", package, "--bins"]);
    if is_release {
        command.arg("--release");
    }
    assert!(command.status().expect("cargo runs").success());
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
