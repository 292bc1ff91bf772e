//! The Python environment of the tests, in a folder of our own: pymodbus and pyserial, and Unicorn for its library; all pinned.

use crate::error::Error;
use crate::repo;
use std::path::PathBuf;
use std::process::Command;

/// The environment's interpreter.
pub fn interpreter() -> PathBuf {
    folder().join("bin/python")
}

fn folder() -> PathBuf {
    repo::root().join("target/python")
}

fn requirements() -> PathBuf {
    repo::root().join("tests/python/requirements.txt")
}

/// The list that the environment was made from, beside it: a changed list makes it stale.
fn installed_list() -> PathBuf {
    folder().join("requirements.txt")
}

/// The environment, if it holds what the list asks for today.
pub fn found() -> Option<String> {
    let wanted = std::fs::read(requirements()).ok()?;
    let installed = std::fs::read(installed_list()).ok()?;
    if wanted != installed {
        return None;
    }
    let modules = "import importlib.util as i, sys; \
                   sys.exit(not all(i.find_spec(m) for m in ('pymodbus', 'serial')))";
    repo::output_of(Command::new(interpreter()).args(["-c", modules]))?;
    Some("target/python".to_owned())
}

/// Unicorn's library, which is loaded by the simulated bus and not by Python, where the environment has it.
pub fn unicorn() -> Option<String> {
    found()?;
    let versions = std::fs::read_dir(folder().join("lib")).ok()?;
    let libraries = versions.flatten().flat_map(|version| {
        let folder = version.path().join("site-packages/unicorn/lib");
        ["libunicorn.so.2", "libunicorn.2.dylib"].map(|name| folder.join(name))
    });
    let mut there = libraries.filter(|path| path.is_file());
    there.next().map(|_| "target/python".to_owned())
}

/// Makes the environment anew.
///
/// # Errors
/// [`Error::failed`] when there is no usable Python or the packages cannot be fetched.
pub fn install() -> Result<(), Error> {
    let folder = folder();
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(|error| Error::io(folder.display(), error))?;
    }
    repo::run(Command::new("python3").args(["-m", "venv"]).arg(&folder))?;
    repo::run(
        Command::new(interpreter())
            .args([
                "-m",
                "pip",
                "install",
                "--quiet",
                "--disable-pip-version-check",
            ])
            .args([
                "--require-hashes",
                "--only-binary",
                ":all:",
                "--requirement",
            ])
            .arg(requirements()),
    )?;
    // Last, so that an interrupted installation is not taken for a finished one.
    std::fs::copy(requirements(), installed_list())
        .map_err(|error| Error::io(installed_list().display(), error))?;
    Ok(())
}
